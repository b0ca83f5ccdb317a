"""The slave of the layer setting services: frames in, answers and actions out (CiA 305)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

from drivers.cia301 import lss
from drivers.cia301.lss import Command, Identity, Mode


@dataclass(frozen=True, slots=True)
class StartNode:
    """A node that had no node-ID has one now and left configuration: boot up as `node`."""

    node: int


@dataclass(frozen=True, slots=True)
class ActivateBitRate:
    """Be silent for `delay_ms`, switch to `kbit_s`, and be silent for `delay_ms` again."""

    kbit_s: int
    delay_ms: int


@dataclass(frozen=True, slots=True)
class StoreConfiguration:
    """Keep these over a power cycle. `node` may be `lss.UNCONFIGURED`."""

    node: int
    kbit_s: int


Action: TypeAlias = StartNode | ActivateBitRate | StoreConfiguration
Reply: TypeAlias = tuple[list[bytes], list[Action]]

_OK: Final = 0
_NOT_SUPPORTED: Final = 1
_MEDIA_ERROR: Final = 2


class LssSlave:
    """One slave. Its owner feeds it the frames of 7E5h, sends the answers on 7E4h, carries the actions out.

    A node-ID that is configured takes effect at once in a node that had none (`StartNode`, on leaving
    configuration), and at the next reset of the communication otherwise: the owner then calls `reset` and
    uses `node`. `storage_works` = False makes STORE answer with the medium's error.
    """

    def __init__(
        self,
        identity: Identity,
        *,
        node: int = lss.UNCONFIGURED,
        kbit_s: int = 1000,
        bit_rates: frozenset[int] = frozenset(lss.BIT_RATE_INDEX),
    ) -> None:
        self.identity = identity
        self.node = node
        """The node-ID in force, or `lss.UNCONFIGURED`."""
        self.pending_node = node
        """The node-ID after the next reset."""
        self.pending_kbit_s = kbit_s
        """The bit rate that the next activation, or a power cycle after STORE, brings."""
        self.storage_works = True
        self.mode = Mode.WAITING
        self._bit_rates: Final = bit_rates
        self._matched_select = 0
        self._matched_identify = 0
        self._scan_sub = 0
        self._handlers: Final[dict[int, Callable[[bytes], Reply]]] = {
            Command.SWITCH_GLOBAL: self._on_switch_global,
            **dict.fromkeys(lss.SELECT_COMMANDS, self._on_select),
            **dict.fromkeys(lss.IDENTIFY_COMMANDS, self._on_identify),
            Command.IDENTIFY_NON_CONFIGURED: self._on_identify_non_configured,
            Command.FASTSCAN: self._on_fastscan,
        }
        self._configuration_handlers: Final[dict[int, Callable[[bytes], Reply]]] = {
            Command.CONFIGURE_NODE_ID: self._on_configure_node_id,
            Command.CONFIGURE_BIT_TIMING: self._on_configure_bit_timing,
            Command.ACTIVATE_BIT_TIMING: self._on_activate,
            Command.STORE: self._on_store,
            **dict.fromkeys(lss.INQUIRE_COMMANDS, self._on_inquire),
            Command.INQUIRE_NODE_ID: self._on_inquire_node_id,
        }

    def reset(self) -> None:
        """A reset of the communication: the pending node-ID comes into force, the state is waiting."""
        self.node = self.pending_node
        self.mode = Mode.WAITING
        self._matched_select = self._matched_identify = self._scan_sub = 0

    def feed(self, data: bytes) -> Reply:
        """Answers and actions for one frame; both empty for what is malformed, unknown or out of place."""
        if len(data) != 8:
            return [], []
        handler = self._handlers.get(data[0])
        if handler is None and self.mode is Mode.CONFIGURATION:
            handler = self._configuration_handlers.get(data[0])
        return handler(data) if handler is not None else ([], [])

    def _on_switch_global(self, data: bytes) -> Reply:
        if data[1] == Mode.CONFIGURATION:
            self.mode = Mode.CONFIGURATION
        elif data[1] == Mode.WAITING and self.mode is Mode.CONFIGURATION:
            self.mode = Mode.WAITING
            if self.node == lss.UNCONFIGURED != self.pending_node:
                self.node = self.pending_node
                return [], [StartNode(self.node)]
        return [], []

    def _on_select(self, data: bytes) -> Reply:
        part = data[0] - Command.SELECT_VENDOR
        if self.mode is not Mode.WAITING:
            return [], []
        self._matched_select = _advance(
            self._matched_select, part, matches=_value(data) == self.identity[part]
        )
        if self._matched_select < len(self.identity):
            return [], []
        self._matched_select = 0
        self.mode = Mode.CONFIGURATION
        return [lss.frame(Command.SELECTED)], []

    def _on_identify(self, data: bytes) -> Reply:
        part = data[0] - Command.IDENTIFY_VENDOR
        value, identity = _value(data), self.identity
        matches = (
            value == identity.vendor,
            value == identity.product,
            value <= identity.revision,
            value >= identity.revision,
            value <= identity.serial,
            value >= identity.serial,
        )
        self._matched_identify = _advance(self._matched_identify, part, matches=matches[part])
        if self._matched_identify < len(matches):
            return [], []
        self._matched_identify = 0
        return [lss.frame(Command.IDENTIFIED)], []

    def _on_identify_non_configured(self, _: bytes) -> Reply:
        if self.node == self.pending_node == lss.UNCONFIGURED:
            return [lss.frame(Command.NON_CONFIGURED)], []
        return [], []

    def _on_fastscan(self, data: bytes) -> Reply:
        bit_check, sub, following = data[5], data[6], data[7]
        if self.mode is not Mode.WAITING or not self.node == self.pending_node == lss.UNCONFIGURED:
            return [], []
        if bit_check == lss.FASTSCAN_RESET:
            self._scan_sub = 0
            return [lss.frame(Command.IDENTIFIED)], []
        if bit_check > 31 or sub != self._scan_sub or sub > 3 or following > 3:
            return [], []
        if (_value(data) ^ self.identity[sub]) >> bit_check:
            return [], []
        if bit_check == 0:
            if sub == len(self.identity) - 1 and following < sub:
                self.mode = Mode.CONFIGURATION
            self._scan_sub = following
        return [lss.frame(Command.IDENTIFIED)], []

    def _on_configure_node_id(self, data: bytes) -> Reply:
        node = data[1]
        if not (1 <= node <= 127 or node == lss.UNCONFIGURED):
            return _configured(Command.CONFIGURE_NODE_ID, _NOT_SUPPORTED)
        self.pending_node = node
        return _configured(Command.CONFIGURE_NODE_ID, _OK)

    def _on_configure_bit_timing(self, data: bytes) -> Reply:
        rate = lss.BIT_RATES.get(data[2]) if data[1] == lss.STANDARD_TABLE else None
        if rate is None or rate not in self._bit_rates:
            return _configured(Command.CONFIGURE_BIT_TIMING, _NOT_SUPPORTED)
        self.pending_kbit_s = rate
        return _configured(Command.CONFIGURE_BIT_TIMING, _OK)

    def _on_activate(self, data: bytes) -> Reply:
        return [], [ActivateBitRate(self.pending_kbit_s, int.from_bytes(data[1:3], "little"))]

    def _on_store(self, _: bytes) -> Reply:
        if not self.storage_works:
            return _configured(Command.STORE, _MEDIA_ERROR)
        answers, _actions = _configured(Command.STORE, _OK)
        return answers, [StoreConfiguration(self.pending_node, self.pending_kbit_s)]

    def _on_inquire(self, data: bytes) -> Reply:
        value = self.identity[data[0] - Command.INQUIRE_VENDOR]
        return [lss.frame(Command(data[0]), value.to_bytes(4, "little"))], []

    def _on_inquire_node_id(self, _: bytes) -> Reply:
        return [lss.frame(Command.INQUIRE_NODE_ID, bytes((self.node,)))], []


def _configured(command: Command, error: int) -> Reply:
    return [lss.frame(command, bytes((error,)))], []


def _value(data: bytes) -> int:
    return int.from_bytes(data[1:5], "little")


def _advance(matched: int, part: int, *, matches: bool) -> int:
    """How many requests of a series have matched in order, after one more."""
    if not matches or part not in (0, matched):
        return 0
    return part + 1
