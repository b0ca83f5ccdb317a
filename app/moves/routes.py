"""The commands that move an axis.

Each answers with an operation: the motion is the service's, not the client's.
"""

from __future__ import annotations

from fastapi import Response

from app.axes.deps import AxisDep
from app.axes.units import Scale
from app.http.documentation import MOVING, Responses, problems
from app.http.parameters import DryRun
from app.http.paths import API
from app.http.problems import ApiError
from app.http.routing import Router
from app.moves import views
from app.moves.deps import MeantDep
from app.moves.going import MoveDep
from app.moves.schemas import HomeBody, PreviewReply, SetPositionBody, VelocityBody
from app.operations.answers import ANSWERED
from app.operations.schemas import OperationReply
from app.operations.starting import StarterDep
from drivers.master.motions.motion import Motion, MotionKind
from drivers.master.plan.requests import HomeRequest, MoveRequest, OnBusy, SetPositionRequest, VelocityRequest

ANSWERS: Responses = {**ANSWERED, **problems(*MOVING)}
PREVIEWED: Responses = {
    200: {
        **ANSWERED[200],
        "description": "It ended while the request waited; `state` says how. Or the answer to a dry run.",
        "model": OperationReply | PreviewReply,
    }
}
"""How one answers that can be looked at before it is given."""

router = Router(
    f"{API}/nodes/{{node}}/axes/{{axis}}",
    tags=["moves"],
    responses=ANSWERS,
)


@router.post(
    "/move",
    summary="Go to a position",
    status_code=202,
    responses={**PREVIEWED, **problems(*MOVING, "unknown_position", "store_off")},
)
async def move_axis(
    body: MoveDep,
    axis: AxisDep,
    meant: MeantDep,
    starter: StarterDep,
    response: Response,
    dry_run: DryRun = False,
) -> OperationReply | PreviewReply:
    """Go to a position, told or taught, or by a distance.

    Refused with a reason if the axis can't; nothing is sent then. A queued distance counts from where the
    operation before it ends.
    """
    scale = Scale.named(body.unit, axis.config)
    on_busy = OnBusy(body.on_busy)
    wanted = scale.exact("target", body.target)
    target, aim = meant.target(axis, wanted, on_busy, relative=body.relative)
    request = MoveRequest(
        target=target,
        relative=body.relative,
        velocity=scale.rate("velocity", body.velocity),
        acceleration=scale.rate("acceleration", body.acceleration),
        deceleration=scale.rate("deceleration", body.deceleration),
    )
    asked = body.model_dump(exclude_none=True) | scale.commanded("target", body.target, request.target)
    if dry_run:
        response.status_code = 200
        return views.preview(MotionKind.MOVE.value, axis, axis.preview(request, on_busy), asked)

    def begin(operation_id: str) -> Motion:
        motion = axis.move_to(request, on_busy=on_busy, operation_id=operation_id)
        meant.sent(axis, aim)
        return motion

    return await starter.start(MotionKind.MOVE, axis, asked, begin)


@router.post("/velocity", summary="Run at a speed", status_code=202, responses=PREVIEWED)
async def run_axis(
    body: VelocityBody, axis: AxisDep, starter: StarterDep, response: Response, dry_run: DryRun = False
) -> OperationReply | PreviewReply:
    """Run at a speed until something else is commanded, or to at most one of three ends. 0 ramps down.

    Without an end it succeeds when the speed is reached. With `duration_s` or `travel` it lives until
    standstill; with `lease` until it is stopped, by the end of the lease at the latest.
    """
    if body.lease and not starter.holds(axis):
        raise ApiError(
            "bad_value",
            "lease: the request is sent under no lease of this axis.",
            hint="Send the header Lease, or another end.",
        )
    scale = Scale.named(body.unit, axis.config)
    request = VelocityRequest(
        velocity=scale.steps("velocity", body.velocity),
        acceleration=scale.rate("acceleration", body.acceleration),
        duration_s=body.duration_s,
        travel=scale.rate("travel", body.travel),
        held=body.lease,
    )
    asked = body.model_dump(exclude_none=True) | scale.commanded("velocity", body.velocity, request.velocity)
    if request.travel is not None:
        asked["travel_steps"] = request.travel
    on_busy = OnBusy(body.on_busy)
    if dry_run:
        response.status_code = 200
        return views.preview(MotionKind.VELOCITY.value, axis, axis.preview(request, on_busy), asked)
    return await starter.start(
        MotionKind.VELOCITY,
        axis,
        asked,
        lambda operation_id: axis.run_at(request, on_busy=on_busy, operation_id=operation_id),
    )


@router.post("/set-position", summary="Say where the axis stands", status_code=202)
async def set_position(
    body: SetPositionBody, axis: AxisDep, meant: MeantDep, starter: StarterDep
) -> OperationReply:
    """Give the place where the axis stands a position (homing method 35). Nothing moves; it needs no power.

    The axis counts as homed afterwards. Travel limits and home offset keep their numbers.
    """
    scale = Scale.named(body.unit, axis.config)
    aim = scale.exact("position", body.position)
    request = SetPositionRequest(round(aim), shift_limits=body.shift_limits)
    asked = body.model_dump() | scale.commanded("position", body.position, request.position)

    def begin(operation_id: str) -> Motion:
        motion = axis.set_position(request, operation_id=operation_id)
        meant.sent(axis, aim)
        return motion

    return await starter.start(MotionKind.SET_POSITION, axis, asked, begin)


@router.post("/home", summary="Seek the reference", status_code=202, responses=PREVIEWED)
async def home_axis(
    body: HomeBody, axis: AxisDep, starter: StarterDep, response: Response, dry_run: DryRun = False
) -> OperationReply | PreviewReply:
    """Seek the reference with a homing method of the module."""
    rates = (body.fast, body.slow, body.acceleration)
    if body.unit is None and any(rate is not None for rate in rates):
        raise ApiError("bad_value", "A speed or acceleration needs its unit.", hint="Add unit to the body.")
    scale = Scale.of(axis.config) if body.unit is None else Scale.named(body.unit, axis.config)
    request = HomeRequest(
        method=body.method,
        fast=scale.rate("fast", body.fast),
        slow=scale.rate("slow", body.slow),
        acceleration=scale.rate("acceleration", body.acceleration),
        timeout_s=body.timeout_s,
    )
    asked = body.model_dump(exclude_none=True)
    on_busy = OnBusy(body.on_busy)
    if dry_run:
        response.status_code = 200
        return views.preview(MotionKind.HOME.value, axis, axis.preview(request, on_busy), asked)
    return await starter.start(
        MotionKind.HOME,
        axis,
        asked,
        lambda operation_id: axis.home(request, on_busy=on_busy, operation_id=operation_id),
    )
