"""What a node must hold as a whole before it may be used: heartbeats both ways, fail-safe, PDOs; all read
back.
"""

from __future__ import annotations

from collections.abc import Iterable

from drivers.cia301.heartbeat import consumer_entry
from drivers.cia301.objects import Address
from drivers.cia301.pdo import PdoConfiguration, remap_steps
from drivers.errors import ConfigurationRefused, SdoAborted
from drivers.master.config import NetworkConfig
from drivers.master.object_access import ObjectAccess
from drivers.master.sdo_client import Priority
from drivers.master.status import Failsafe

CONSUMER_HEARTBEAT = Address(0x1016, 1)
PRODUCER_HEARTBEAT = Address(0x1017)
ERROR_BEHAVIOUR = Address(0x1029, 1)

_STOPPED_BY_CIA = 2
"""1029h:1 in CiA 301: enter NMT Stopped."""
_STOPPED_BY_MANUAL = 0
"""1029h:1 in manual §3.1.14: enter NMT Stopped; in CiA 301 it is Pre-operational, which stops no motor."""


async def produce_heartbeat(objects: ObjectAccess, config: NetworkConfig) -> None:
    """1017h, so that every later NMT command is seen to be followed."""
    await objects.establish(PRODUCER_HEARTBEAT, config.node_heartbeat_ms)


async def arm_failsafe(objects: ObjectAccess, config: NetworkConfig) -> Failsafe:
    """Have the node stop its motors when our heartbeat ends.

    The two readings of 1029h:1 contradict each other (unverified on hardware): 2 is written first, and 0, the
    manual's word for the same, only if the node refuses 2.
    """
    await objects.establish(CONSUMER_HEARTBEAT, consumer_entry(config.master_node_id, config.consumer_ms))
    for value in (_STOPPED_BY_CIA, _STOPPED_BY_MANUAL):
        try:
            await objects.write(ERROR_BEHAVIOUR, value, priority=Priority.CONFIGURE)
            if await objects.read_int(ERROR_BEHAVIOUR, priority=Priority.CONFIGURE) == value:
                return Failsafe.UNVERIFIED
        except SdoAborted:
            continue
    return Failsafe.OFF


async def remap(node_id: int, objects: ObjectAccess, pdos: Iterable[PdoConfiguration]) -> None:
    """Write the PDOs in the order of manual §3.1.16 and read every record back.

    Raises `ConfigurationRefused`.
    """
    for pdo in pdos:
        final: dict[Address, int] = {}
        for step in remap_steps(pdo):
            try:
                await objects.write(step.address, step.value, priority=Priority.CONFIGURE)
            except SdoAborted as abort:
                raise ConfigurationRefused(
                    f"Node {node_id} would not take {step.value:X}h for {step.address} of PDO {pdo.number}: "
                    f"{abort.meaning}.",
                    hint="Check the model and firmware of the module.",
                    node=node_id,
                    index=step.address.index,
                    sub=step.address.sub,
                ) from abort
            final[step.address] = step.value
        for address, value in final.items():
            held = await objects.read_int(address, priority=Priority.CONFIGURE)
            if held != value:
                raise ConfigurationRefused(
                    f"Node {node_id} holds {held:X}h in {address} of PDO {pdo.number}, not {value:X}h.",
                    hint="Check the module's model and firmware, and that no second master writes to it.",
                    node=node_id,
                    index=address.index,
                    sub=address.sub,
                )
