"""What a node must hold as a whole before it may be used: heartbeats both ways, fail-safe, PDOs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from drivers.cia301.cob import NO_RTR, PdoCobId
from drivers.cia301.heartbeat import consumer_entry
from drivers.cia301.objects import Address
from drivers.cia301.pdo import PdoConfiguration, WriteStep, pdo_mapping_index, remap_steps
from drivers.errors import ConfigurationRefused
from drivers.master.link.holding import Establisher
from drivers.master.plan.configuration import NetworkConfig
from drivers.master.seen.status import Failsafe

CONSUMER_HEARTBEAT = Address(0x1016, 1)
PRODUCER_HEARTBEAT = Address(0x1017)
ERROR_BEHAVIOUR = Address(0x1029, 1)

_STOPPED_BY_CIA = 2
"""1029h:1 in CiA 301: enter NMT Stopped."""
_STOPPED_BY_MANUAL = 0
"""1029h:1 in manual §3.1.14: enter NMT Stopped; in CiA 301 it is Pre-operational, which stops no motor."""


async def exchange_heartbeats(establisher: Establisher, config: NetworkConfig) -> Failsafe:
    """The node's heartbeat to us, and its watch over ours: its motors stop when that ends.

    The two readings of 1029h:1 contradict each other (unverified on hardware): 2 is wanted, and 0, the
    manual's word for the same, only accepted if the node refuses 2.
    """
    await establisher.hold(PRODUCER_HEARTBEAT, config.node_heartbeat_ms)
    await establisher.hold(CONSUMER_HEARTBEAT, consumer_entry(config.master_node_id, config.consumer_ms))
    for value in (_STOPPED_BY_CIA, _STOPPED_BY_MANUAL):
        try:
            await establisher.hold(ERROR_BEHAVIOUR, value)
        except ConfigurationRefused:
            continue
        return Failsafe.UNVERIFIED
    return Failsafe.OFF


@dataclass(frozen=True, slots=True)
class PdoDifference:
    """A PDO that is not as it should be, and what its objects hold instead (None: unreadable)."""

    pdo: PdoConfiguration
    held: Mapping[Address, int | None]

    @property
    def steps(self) -> tuple[WriteStep, ...]:
        """The writes that are needed, in the order of manual §3.1.16.

        A PDO that is switched off already is not switched off again, and the parts that agree are left alone.
        """
        every = remap_steps(self.pdo)
        if len(every) == 1:
            return every
        first, *middle, last = every
        final = {step.address: step.value for step in middle}
        differing = {address for address, value in final.items() if self.held[address] != value}
        mapping = pdo_mapping_index(self.pdo.direction, self.pdo.number)
        if any(address.index == mapping for address in differing):
            differing.add(Address(mapping, 0))  # no entry changes while it is counted
        kept = [step for step in middle if step.address in differing]
        before = self.held[last.address]
        valid = before is None or PdoCobId.decode(before).valid
        return (*((first,) if valid else ()), *kept, last)


async def compare_pdos(establisher: Establisher, pdos: Iterable[PdoConfiguration]) -> list[PdoDifference]:
    """Which of these the node does not hold as they are planned. Reads only."""
    found: list[PdoDifference] = []
    for pdo in pdos:
        wanted = {step.address: step.value for step in remap_steps(pdo)}
        held = {address: await establisher.read(address) for address in wanted}
        cob_id = next(iter(wanted))
        if (value := held[cob_id]) is not None:
            held[cob_id] = value | NO_RTR  # may be asked for by remote frames, which nobody here sends
        if held != wanted and not _is_off(pdo, held):
            found.append(PdoDifference(pdo, held))
    return found


async def remap(establisher: Establisher, difference: PdoDifference) -> None:
    """Write what differs and read it back. Raises `ConfigurationRefused`."""
    steps = difference.steps
    for step in steps:
        await establisher.write(step.address, step.value)
    for address, value in {step.address: step.value for step in steps}.items():
        ignored = NO_RTR if address == steps[-1].address else 0
        await establisher.confirm(address, value, difference.held[address], ignored=ignored)


def _is_off(pdo: PdoConfiguration, held: Mapping[Address, int | None]) -> bool:
    """Whether a PDO that is to be off is off, whatever identifier it keeps."""
    value = next(iter(held.values()))
    return not pdo.enabled and value is not None and not PdoCobId.decode(value).valid
