"""An axis: its status, and bringing its drive from one state to another."""

from __future__ import annotations

from fastapi import Depends

from app.axes import views
from app.axes.deps import AxisDep, NodeDep
from app.axes.direct import AxisRoute
from app.axes.schemas import AxisList, AxisStatusReply, ReadinessReply
from app.http.documentation import AXIS, AXIS_COMMAND, NODE, problems
from app.http.parameters import empty_body
from app.http.paths import API
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.idempotency.deps import command_headers
from app.leases.deps import LeasesDep

router = Router(f"{API}/nodes/{{node}}/axes", tags=["axes"])
reports = Router(f"{API}/nodes/{{node}}/axes/{{axis}}", tags=["axes"], route_class=AxisRoute)
commands = Router(
    f"{API}/nodes/{{node}}/axes/{{axis}}",
    tags=["axes"],
    route_class=AxisRoute,
    dependencies=[Depends(command_headers), Depends(empty_body)],
    responses=problems(*AXIS_COMMAND),
)


@router.get("", summary="All axes of a node", responses=problems(*NODE))
async def list_axes(node: NodeDep, leases: LeasesDep) -> AxisList:
    """The status of each axis."""
    return AxisList(axes=[views.axis_status(axis, leases) for axis in node.axes])


@reports.get("", summary="Status of an axis", responses=problems(*AXIS))
async def get_axis(leases: LeasesDep, axis: AxisDep) -> AxisStatusReply:
    """What the axis does now. Costs the bus nothing: it is the module's last report, with its age."""
    return views.axis_status(axis, leases)


@reports.get("/readiness", summary="What prevents a command", responses=problems(*AXIS))
async def get_readiness(axis: AxisDep) -> ReadinessReply:
    """What prevents each command now, each reason with its remedy."""
    return views.readiness(axis)


@commands.post("/enable", summary="Switch the power stage on")
async def enable_axis(tasks: TasksDep, leases: LeasesDep, axis: AxisDep) -> AxisStatusReply:
    """Bring the drive to OPERATION_ENABLED; it holds its position from then on. Answers when it is there."""
    await tasks.command(axis.enable())
    return views.axis_status(axis, leases)


@commands.post("/disable", summary="Switch the power stage off")
async def disable_axis(tasks: TasksDep, leases: LeasesDep, axis: AxisDep) -> AxisStatusReply:
    """Ramp down, then switch off: the motor holds no torque any more. Answers when it is done."""
    await tasks.unconditional(axis.disable())
    return views.axis_status(axis, leases)


@commands.post("/reset-fault", summary="Leave the fault state")
async def reset_fault(tasks: TasksDep, leases: LeasesDep, axis: AxisDep) -> AxisStatusReply:
    """Acknowledge the fault. The axis stays disabled until it is enabled again."""
    await tasks.command(axis.reset_fault())
    return views.axis_status(axis, leases)


@commands.post("/stop", summary="Ramp down and stay enabled")
async def stop_axis(tasks: TasksDep, leases: LeasesDep, axis: AxisDep) -> AxisStatusReply:
    """Controlled stop; it ends the running operation. Needs no body, heeds no key. Answers at standstill."""
    axis.begin_stop("The axis was stopped.")  # now: a new task would wait for its turn
    await tasks.unconditional(axis.stop())
    return views.axis_status(axis, leases)


@commands.post("/quick-stop", summary="Ramp down fast and switch off")
async def quick_stop_axis(tasks: TasksDep, leases: LeasesDep, axis: AxisDep) -> AxisStatusReply:
    """Quick stop of the drive (CiA 402): the steepest ramp, then switched off. Needs no body."""
    await tasks.unconditional(axis.quick_stop())
    return views.axis_status(axis, leases)
