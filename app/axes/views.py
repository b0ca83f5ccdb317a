"""From the drivers' snapshots to the wire models: the one place that shapes what a client sees."""

from __future__ import annotations

from collections.abc import Sequence

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
from app.http import remedies
from app.http.schemas import ObstacleReply
from app.leases.leases import Leases
from drivers.errors import Obstacle
from drivers.master.axis.axis import Axis
from drivers.master.axis.commands import AxisCommand
from drivers.master.plan.prediction import Prediction
from drivers.master.seen.boot_log import Change
from drivers.master.seen.status import Adoption


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


def peak(axis: Axis, expected: Prediction | None) -> Quantity | None:
    """The highest speed of a prediction."""
    return None if expected is None else Scale.of(axis.config).quantity(round(expected.peak_velocity), "/s")


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
