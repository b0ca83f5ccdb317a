"""From the drivers' snapshots to the wire models: the one place that shapes what a client sees."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from enum import Enum
from typing import TYPE_CHECKING, Any, cast

from app.axes.schemas import (
    ActiveEmergency,
    AxisLease,
    AxisStatusReply,
    ChangeReply,
    FoundReply,
    Limits,
    Quantity,
    ReadinessReply,
)
from app.axes.units import Scale
from app.bus.schemas import BusReply
from app.http import remedies
from app.http.schemas import ObstacleReply
from app.io.schemas import AnalogInputReply, DigitalInputReply, InputsReply, OutputReply, SwitchReply
from app.moves.previews import PathReply, PreviewReply
from app.nodes.schemas import AxisName, BootReply, BootStepReply, EmergencyReply, IdentityReply, NodeReply
from app.positions.schemas import NamedPositionReply
from app.positions.table import NamedPosition
from app.stop.schemas import AxisStopReply, StopReply, StopState
from drivers.errors import Obstacle
from drivers.master.axis.axis import Axis
from drivers.master.axis.outlook import Preview
from drivers.master.axis.readiness import AxisCommand
from drivers.master.node.conditions import switches_of
from drivers.master.node.io import AnalogLevel, DigitalLevel, Output
from drivers.master.node.node import Node
from drivers.master.plan.prediction import Prediction
from drivers.master.seen.boot_log import BootStep, Change, StepState
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.status import Adoption
from drivers.master.seen.stops import StopLatch, StopReport

if TYPE_CHECKING:
    from app.leases.leases import Leases
    from app.service import Service


def axis_path(axis: Axis) -> str:
    """Where an axis is."""
    return f"/api/v1/nodes/{axis.node.node_id}/axes/{axis.number}"


def axis_status(axis: Axis, leases: Leases) -> AxisStatusReply:
    """An axis as its last TPDOs left it, and who has it."""
    lease = leases.of(axis)
    status = axis.status
    scale = Scale.of(axis.config)
    motion = axis.motion
    age = axis.age()
    return AxisStatusReply(
        node=axis.node.node_id,
        axis=axis.number,
        name=axis.name,
        state=None if status.state is None else status.state.value,
        mode=status.mode.name.lower(),
        statusword=f"0x{status.statusword:04X}",
        position=None if status.position is None else scale.quantity(status.position),
        velocity=None if status.velocity is None else scale.quantity(status.velocity, "/s"),
        target_reached=status.target_reached,
        moving=status.moving,
        referenced=status.referenced,
        reference=status.reference.value,
        adopted=status.adopted is not None,
        found=None if status.adopted is None else _found(status.adopted, scale),
        limits=Limits(negative=status.switches.negative_limit, positive=status.switches.positive_limit),
        home_switch=status.switches.home,
        emergencies=[
            ActiveEmergency(id=e.id, code=f"0x{e.code:04X}", title=e.title, cause=e.cause, remedy=e.remedy)
            for e in status.emergencies
        ],
        operation=None if motion is None or motion.done else motion.id,
        queued=[waiting.id for waiting in axis.queued],
        lease=None
        if lease is None
        else AxisLease(id=lease.id, owner=lease.owner, expires_in_s=leases.left(lease)),
        age_s=None if age is None else round(age, 4),
        stale=status.stale,
    )


def _found(adoption: Adoption, scale: Scale) -> FoundReply:
    return FoundReply(
        reason=adoption.reason,
        state=None if adoption.state is None else adoption.state.value,
        mode=adoption.mode.name.lower(),
        moving=adoption.moving,
        position=None if adoption.position is None else scale.quantity(adoption.position),
        velocity=None if adoption.velocity is None else scale.quantity(adoption.velocity, "/s"),
    )


def obstacles(axis: Axis, found: Sequence[Obstacle]) -> list[ObstacleReply]:
    """What prevents a command on an axis."""
    node, number = axis.node.node_id, axis.number
    return [ObstacleReply.model_validate(remedies.obstacle(one, node, number)) for one in found]


def readiness(axis: Axis) -> ReadinessReply:
    """What prevents each command on an axis now."""
    found = {command.value: obstacles(axis, axis.readiness(command)) for command in _ANSWERABLE}
    return ReadinessReply(ready=not found["move"], **found)


_ANSWERABLE = tuple(AxisCommand(name) for name in ReadinessReply.model_fields if name != "ready")


def preview(kind: str, axis: Axis, seen: Preview, asked: Mapping[str, Any]) -> PreviewReply:
    """What a command would come to."""
    scale = Scale.of(axis.config)

    def place(steps: int | None) -> Quantity | None:
        return None if steps is None else scale.quantity(steps)

    expected = seen.prediction
    path = None
    if expected is not None and expected.path is not None and seen.within is not None:
        path = PathReply(
            lowest=scale.quantity(expected.path[0]),
            highest=scale.quantity(expected.path[1]),
            limit_low=scale.quantity(seen.limits[0]),
            limit_high=scale.quantity(seen.limits[1]),
            within=seen.within,
        )
    return PreviewReply(
        dry_run=True,
        kind=kind,
        node=axis.node.node_id,
        axis=axis.number,
        name=axis.name,
        accepted=seen.admission is not None,
        begins=None if seen.admission is None else seen.admission.value,
        obstacles=obstacles(axis, seen.obstacles),
        request=dict(asked),
        predicted_s=None if expected is None else round(expected.duration_s, 4),
        predicted_peak_velocity=peak(axis, expected),
        start=None if expected is None else place(expected.start),
        end=None if expected is None else place(expected.end),
        path=path,
        assumed=[] if expected is None else list(expected.assumed),
        writes=[change(one) for one in seen.changes],
    )


def peak(axis: Axis, expected: Prediction | None) -> Quantity | None:
    """The highest speed of a prediction."""
    return None if expected is None else Scale.of(axis.config).quantity(round(expected.peak_velocity), "/s")


def node(node: Node) -> NodeReply:
    """A node as it is now."""
    status = node.status()
    identity = status.identity
    return NodeReply(
        node=node.node_id,
        name=node.name,
        model=node.config.model,
        state=status.state.value,
        reason=status.reason,
        nmt_state=None if status.nmt_state is None else status.nmt_state.name.lower(),
        identity=None
        if identity is None
        else IdentityReply(
            device_type=f"0x{identity.device_type:08X}",
            vendor_id=f"0x{identity.vendor_id:08X}",
            product_code=f"0x{identity.product_code:08X}",
            revision=identity.revision,
            serial=identity.serial,
        ),
        device_name=status.device_name,
        hardware_version=status.hardware_version,
        software_version=status.software_version,
        serial=status.serial,
        failsafe=status.failsafe.value,
        heartbeat_age_s=None if status.heartbeat_age_s is None else round(status.heartbeat_age_s, 4),
        boot=_boot(status.boot),
        axes=[
            AxisName(axis=axis.number, name=axis.name, unit=axis.config.unit, path=axis_path(axis))
            for axis in node.axes
        ],
        counters=dataclasses.asdict(status.counters),
    )


def _boot(steps: Sequence[BootStep]) -> BootReply:
    return BootReply(
        complete=all(step.state in (StepState.DONE, StepState.SKIPPED) for step in steps),
        took_s=round(sum(step.took_s or 0.0 for step in steps), 4),
        steps=[_boot_step(step) for step in steps],
    )


def _boot_step(step: BootStep) -> BootStepReply:
    return BootStepReply(
        name=step.name.value,
        state=step.state.value,
        compared=step.compared,
        written=step.written,
        changes=[change(one) for one in step.changes],
        note=step.note,
        reason=step.reason,
        remedy=step.remedy,
        took_s=None if step.took_s is None else round(step.took_s, 4),
    )


def named_position(axis: Axis, position: NamedPosition) -> NamedPositionReply:
    """One named position of an axis."""
    per_unit = axis.config.units.get(position.unit)
    scale = Scale.of(axis.config) if per_unit is None else Scale(position.unit, per_unit)
    low, high = axis.config.target_range
    return NamedPositionReply(
        name=position.name,
        position=scale.quantity(position.steps),
        unreferenced=not position.needs_reference,
        within_limits=low <= position.steps <= high,
        taught=position.taught,
        taught_by=position.taught_by,
    )


def inputs(
    node: Node, digital: Sequence[DigitalLevel], analog: Sequence[AnalogLevel], age_s: float
) -> InputsReply:
    """The inputs of a node; `age_s`: since the levels were asked for."""
    switches: list[SwitchReply] = []
    for axis, switch, name in switches_of(node):
        age = axis.age()
        switches.append(
            SwitchReply(
                axis=axis.number,
                name=name,
                on=bool(getattr(axis.status.switches, switch)),
                age_s=None if age is None else round(age, 4),
                stale=axis.status.stale,
            )
        )
    return InputsReply(
        node=node.node_id,
        digital=[DigitalInputReply(number=d.number, name=d.name, on=d.on) for d in digital],
        analog=[
            AnalogInputReply(
                number=a.number,
                name=a.name,
                raw=a.raw,
                volts=None if a.volts is None else round(a.volts, 6),
            )
            for a in analog
        ],
        switches=switches,
        age_s=round(age_s, 4),
    )


def output(node: Node, level: Output) -> OutputReply:
    """One output."""
    return OutputReply(
        node=node.node_id,
        number=level.number,
        name=level.name,
        on=level.on,
        usable=level.usable,
        push_pull=level.push_pull,
    )


def change(one: Change) -> ChangeReply:
    """An object that was, or would be, written."""
    return ChangeReply(
        index=f"0x{one.address.index:04X}",
        sub=one.address.sub,
        name=one.name,
        axis=one.axis,
        old=one.old,
        new=one.new,
        unit=one.unit,
    )


def emergency(record: EmergencyRecord) -> EmergencyReply:
    """One emergency."""
    return EmergencyReply(
        id=record.id,
        time=record.time,
        node=record.node,
        axis=record.axis,
        code=f"0x{record.code:04X}",
        register_=f"0x{record.register:02X}",
        data=record.data.hex(" "),
        title=record.title,
        cause=record.cause,
        remedy=record.remedy,
        severity=record.severity.value,
        active=record.active,
    )


def bus(service: Service) -> BusReply:
    """The wire as it is now."""
    status = service.network.bus_status()
    return BusReply(
        name=status.name,
        state=status.state.value,
        reason=service.bus_problem or status.reason,
        warnings=list(status.warnings),
        counters=dataclasses.asdict(status.counters),
    )


def stop(latch: StopLatch | None) -> StopState:
    """Whether everything is stopped."""
    if latch is None:
        return StopState(latched=False, reason=None, time=None)
    return StopState(latched=True, reason=latch.reason, time=latch.time)


def stop_report(report: StopReport) -> StopReply:
    """What a stop for everything found."""
    return StopReply(
        latched=True,
        reason=report.latch.reason,
        time=report.latch.time,
        complete=report.complete,
        axes=[
            AxisStopReply(node=a.node, axis=a.axis, outcome=a.outcome.value, message=a.message)
            for a in report.axes
        ],
    )


def snapshot(service: Service) -> dict[str, Any]:
    """Everything at once, for the beginning of a stream."""
    nodes = service.network.nodes.values()
    return {
        "time": datetime.now(UTC),
        "bus": bus(service).model_dump(mode="json"),
        "stop": stop(service.network.stop_latched).model_dump(mode="json"),
        "nodes": [node(n).model_dump(mode="json") for n in nodes],
        "axes": [axis_status(a, service.leases).model_dump(mode="json") for n in nodes for a in n.axes],
        "leases": [service.leases.reply(lease).model_dump(mode="json") for lease in service.leases.all()],
        "operations": [o.reply().model_dump(mode="json") for o in service.operations.running()],
    }


def plain(value: object) -> object:
    """A value of an event as JSON knows it."""
    if isinstance(value, Enum):
        return plain(value.value)
    if value is None or isinstance(value, str | int | float | bool | datetime):
        return value
    if isinstance(value, bytes):
        return value.hex(" ")
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in cast("Mapping[object, object]", value).items()}
    if isinstance(value, Sequence):
        return [plain(item) for item in cast("Sequence[object]", value)]
    return str(value)
