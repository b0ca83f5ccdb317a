"""Node ID and bit rate: 2704h, 2705h, 2707h, 2708h and LSS (manual §2.3, §4.2.62-4.2.66)."""

from __future__ import annotations

from typing import Final

from drivers.cia301 import lss
from drivers.cia301.lss import Identity
from drivers.cia301.lss_slave import ActivateBitRate, LssSlave, StartNode, StoreConfiguration
from drivers.cia301.objects import Address
from drivers.sim.dictionary import ObjectDictionary
from drivers.sim.parameters import BIT_RATE, NODE_ID, ParameterMemory
from drivers.sim.storage import StoreError

BIT_RATE_IN_FORCE: Final = Address(0x2707)
NODE_ID_IN_FORCE: Final = Address(0x2708)

_STORE_FAILED: Final = lss.frame(lss.Command.STORE, b"\x02")


class Addressing:
    """Which node ID and bit rate are in force, and which will be after a reset.

    A bit rate that LSS activates is in force at once here; the silence around the switch is not played.
    """

    def __init__(
        self, dictionary: ObjectDictionary, memory: ParameterMemory, identity: Identity, node_id: int
    ) -> None:
        """`node_id` is what the module has while none is saved: 1..127, or 255 for unconfigured."""
        if not (1 <= node_id <= 127 or node_id == lss.UNCONFIGURED):
            raise ValueError(f"a node ID is 1 to 127, or 255 for none, not {node_id}")
        self._dictionary = dictionary
        self._memory = memory
        self._identity = identity
        self._factory_node_id = node_id
        self._slave = LssSlave(identity)
        self.bit_rate = 0
        """In force, kbit/s; 0 before the first power-on."""
        self.saved_node_id = node_id
        """What 2705h reads after a reset."""
        dictionary.attach_live(BIT_RATE_IN_FORCE, lambda: self.bit_rate)
        dictionary.attach_live(NODE_ID_IN_FORCE, lambda: self._slave.node)

    @property
    def node_id(self) -> int | None:
        """The node ID in force; None = unconfigured."""
        return None if self._slave.node == lss.UNCONFIGURED else self._slave.node

    def reset_node(self) -> None:
        """Power-on or reset node: what is saved comes into force."""
        saved = self._memory.saved()
        profile = self._dictionary.profile
        rate = profile.objects[BIT_RATE].default
        self.bit_rate = saved.get(BIT_RATE, rate if isinstance(rate, int) else 1000)
        self.saved_node_id = saved.get(NODE_ID, self._factory_node_id)
        allowed = profile.objects[BIT_RATE].allowed or {}
        self._slave = LssSlave(
            self._identity,
            node=self.saved_node_id,
            kbit_s=self.bit_rate,
            bit_rates=frozenset(allowed) & frozenset(lss.BIT_RATE_INDEX),
        )

    def reset_communication(self) -> None:
        """A node ID that LSS configured comes into force."""
        self._slave.reset()

    def feed(self, data: bytes) -> tuple[list[bytes], bool]:
        """The answers to an LSS request, and whether it gave the module its first node ID, to boot up."""
        answers, actions = self._slave.feed(data)
        boots = False
        for action in actions:
            match action:
                case StartNode():
                    boots = True
                case ActivateBitRate():
                    self.bit_rate = action.kbit_s
                case StoreConfiguration():
                    answers = self._save(action, answers)
        return answers, boots

    def _save(self, action: StoreConfiguration, answers: list[bytes]) -> list[bytes]:
        try:
            self._memory.save_addressing(action.node, action.kbit_s)
        except StoreError:
            return [_STORE_FAILED]
        self._dictionary.load({NODE_ID: action.node, BIT_RATE: action.kbit_s})
        return answers
