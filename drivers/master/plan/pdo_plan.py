"""Which PDO carries what under which COB-ID, for every node of a bus, decided before a frame is sent.

Axis 0 of a node has the node's predefined connection set. The modules know no COB-IDs for further axes, so
each further axis borrows the predefined PDO identifiers of a node ID that nobody on this bus has: from 126
downwards, in the order of the configured node IDs. The plan follows from the configuration alone, so it is
the same after every start. Only the four PDO bands of the borrowed ID are used; its SDO, EMCY and heartbeat
stay free.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from drivers.cia301 import cob
from drivers.cia301.objects import MappedObject
from drivers.cia301.pdo import Direction, PdoConfiguration, PdoMapping
from drivers.cia402 import objects
from drivers.devices.profile import DeviceProfile
from drivers.errors import BadValue
from drivers.master.ground.timing import Timing

_ASYNCHRONOUS = 0xFF
_EVERY_SYNC = 1
_HIGHEST_DONOR = 126

STATUS_OBJECTS = (objects.STATUSWORD, objects.MODE_DISPLAY, objects.DIGITAL_INPUTS)
MOTION_OBJECTS = (objects.POSITION, objects.VELOCITY)
POWER_OBJECTS = (objects.CONTROLWORD, objects.MODE)
POSITION_OBJECTS = (objects.CONTROLWORD, objects.TARGET_POSITION)
VELOCITY_OBJECTS = (objects.CONTROLWORD, objects.TARGET_VELOCITY)


@dataclass(frozen=True, slots=True)
class AxisPdos:
    """The PDOs of one axis."""

    status: PdoConfiguration
    """TPDO 1: statusword, mode, digital inputs."""
    motion: PdoConfiguration
    """TPDO 2: position, velocity."""
    power: PdoConfiguration
    """RPDO 1: controlword, mode."""
    position: PdoConfiguration
    """RPDO 2: controlword, target position."""
    velocity: PdoConfiguration
    """RPDO 3: controlword, target velocity."""
    synchronous: PdoConfiguration
    """RPDO 4: controlword, target position, taken by the module with the next SYNC."""
    unused: tuple[PdoConfiguration, ...]
    """TPDO 3 and 4: switched off."""

    def __iter__(self) -> Iterator[PdoConfiguration]:
        yield from (*self.unused, self.status, self.motion)
        yield from (self.power, self.position, self.velocity, self.synchronous)


@dataclass(frozen=True, slots=True)
class NodePdos:
    """The PDOs of one node."""

    axes: tuple[AxisPdos, ...]
    donors: tuple[int, ...]
    """The node IDs whose PDO identifiers its further axes borrow."""


@dataclass(frozen=True, slots=True)
class PdoPlan:
    """The PDOs of a whole bus."""

    nodes: Mapping[int, NodePdos]
    """By node ID."""

    @classmethod
    def make(cls, profiles: Mapping[int, DeviceProfile], master_node_id: int, timing: Timing) -> PdoPlan:
        """Plan for these nodes (by ID).

        Raises `BadValue` if there are too few free node IDs, or on any clash.
        """
        donors = (n for n in range(_HIGHEST_DONOR, 0, -1) if n not in profiles and n != master_node_id)
        nodes: dict[int, NodePdos] = {}
        for node_id in sorted(profiles):
            profile = profiles[node_id]
            borrowed = tuple(donor for _, donor in zip(range(profile.axes - 1), donors, strict=False))
            if len(borrowed) < profile.axes - 1:
                raise BadValue(
                    f"There are not enough free node IDs left to give every axis of node {node_id} its PDOs.",
                    hint="Put fewer multi-axis modules on this bus, or use a second bus.",
                    node=node_id,
                )
            sources = (node_id, *borrowed)
            nodes[node_id] = NodePdos(
                tuple(_axis_pdos(profile, axis, source, timing) for axis, source in enumerate(sources)),
                borrowed,
            )
        plan = cls(nodes)
        plan._refuse_clashes(master_node_id)
        return plan

    def donors(self) -> Mapping[int, int]:
        """Which node borrows a node ID, by the borrowed ID."""
        return {donor: node_id for node_id, pdos in self.nodes.items() for donor in pdos.donors}

    def _refuse_clashes(self, master_node_id: int) -> None:
        taken: dict[int, str] = {
            cob.NMT: "NMT",
            cob.SYNC: "SYNC",
            cob.TIME: "TIME",
            cob.heartbeat(master_node_id): "the master's heartbeat",
        }

        def take(cob_id: int, owner: str) -> None:
            if cob_id in taken:
                raise BadValue(f"COB-ID {cob_id:03X}h would belong to {owner} and to {taken[cob_id]}.")
            taken[cob_id] = owner

        for node_id in self.nodes:
            for cob_id in (cob.emcy(node_id), cob.sdo_request(node_id), cob.sdo_response(node_id)):
                take(cob_id, f"node {node_id}")
            take(cob.heartbeat(node_id), f"node {node_id}'s heartbeat")
        for node_id, node in self.nodes.items():
            for axis, pdos in enumerate(node.axes):
                for pdo in pdos:
                    if pdo.enabled:
                        if cob.is_restricted(pdo.cob_id):
                            raise BadValue(f"COB-ID {pdo.cob_id:03X}h is restricted (CiA 301).", node=node_id)
                        take(pdo.cob_id, f"a PDO of node {node_id}, axis {axis}")


def _axis_pdos(profile: DeviceProfile, axis: int, source: int, timing: Timing) -> AxisPdos:
    def mapping(indices: tuple[int, ...]) -> PdoMapping:
        specs = [profile.spec(index, 0, axis) for index in indices]
        entries: list[MappedObject] = []
        for spec in specs:
            assert spec.type.bits is not None
            entries.append(MappedObject(spec.index, spec.sub, spec.type.bits))
        return PdoMapping(tuple(entries), tuple(spec.type for spec in specs))

    event_timer_ms = round(timing.pdo_event_timer * 1000)

    def transmit(number: int, indices: tuple[int, ...], inhibit: float) -> PdoConfiguration:
        return PdoConfiguration(
            direction=Direction.TRANSMIT,
            number=profile.layout.pdo_number(number, axis),
            cob_id=cob.tpdo(number, source),
            mapping=mapping(indices),
            transmission_type=_ASYNCHRONOUS,
            inhibit_time_100us=round(inhibit * 10_000),
            event_timer_ms=event_timer_ms,
            enabled=True,
        )

    def receive(
        number: int, indices: tuple[int, ...], transmission_type: int = _ASYNCHRONOUS
    ) -> PdoConfiguration:
        return PdoConfiguration(
            direction=Direction.RECEIVE,
            number=profile.layout.pdo_number(number, axis),
            cob_id=cob.rpdo(number, source),
            mapping=mapping(indices),
            transmission_type=transmission_type,
            inhibit_time_100us=None,
            event_timer_ms=None,
            enabled=True,
        )

    def unused(number: int) -> PdoConfiguration:
        return PdoConfiguration(
            direction=Direction.TRANSMIT,
            number=profile.layout.pdo_number(number, axis),
            cob_id=cob.tpdo(number, source),
            mapping=mapping(()),
            transmission_type=_ASYNCHRONOUS,
            inhibit_time_100us=None,
            event_timer_ms=None,
            enabled=False,
        )

    return AxisPdos(
        status=transmit(1, STATUS_OBJECTS, timing.status_inhibit),
        motion=transmit(2, MOTION_OBJECTS, timing.position_inhibit),
        power=receive(1, POWER_OBJECTS),
        position=receive(2, POSITION_OBJECTS),
        velocity=receive(3, VELOCITY_OBJECTS),
        synchronous=receive(4, POSITION_OBJECTS, _EVERY_SYNC),
        unused=(unused(3), unused(4)),
    )
