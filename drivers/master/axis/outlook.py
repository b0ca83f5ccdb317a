"""Looking before moving: what a command would come to, from what is known without asking the module."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.cia402 import objects
from drivers.errors import Obstacle
from drivers.master.axis.admission import Admission, look
from drivers.master.axis.body import AxisBody
from drivers.master.axis.commands import Question
from drivers.master.drive.stopping import gentlest_ramp
from drivers.master.drive.tools import AxisTools, Parameter
from drivers.master.motions import homing, profile_position, profile_velocity
from drivers.master.plan.prediction import Prediction, predict, predict_rest
from drivers.master.plan.requests import HomeRequest, MoveRequest, OnBusy, Request, VelocityRequest
from drivers.master.seen.boot_log import Change
from drivers.obstacles import BEYOND_LIMITS


@dataclass(frozen=True, slots=True)
class Preview:
    """A command that was not given."""

    admission: Admission | None
    """How it would be begun; None: it would be refused."""
    obstacles: tuple[Obstacle, ...]
    """What prevents it, in the order of what to do first."""
    prediction: Prediction | None
    """None: it can't be told from where it would begin."""
    limits: tuple[int, int]
    """The positions that the axis may be sent to, steps."""
    within: bool | None
    """Whether the whole path lies in there; None: the path is not known."""
    changes: tuple[Change, ...]
    """The parameters that would be written first, with what the module is known to hold."""


def look_ahead(axis: AxisBody, tools: AxisTools, request: Request, on_busy: OnBusy) -> Preview:
    """See `Axis.preview`."""
    admission, found = look(axis, Question.of(request), on_busy)
    prediction = expected(axis, tools, request, admission or _as_if(axis, on_busy))
    limits = tools.config.target_range
    path = None if prediction is None else prediction.path
    within = None if path is None else limits[0] <= path[0] and path[1] <= limits[1]
    target = _target(request, prediction)
    if target is not None and not limits[0] <= target <= limits[1]:
        low, high = limits
        beyond = BEYOND_LIMITS.found(f"It would end at {target}, beyond {low}..{high} steps.")
        admission, found = None, (beyond, *found)
    return Preview(
        admission, found, prediction, limits, within, tools.parameters.changes(_needed(tools, request))
    )


def expected(axis: AxisBody, tools: AxisTools, request: Request, admission: Admission) -> Prediction | None:
    """What a command that is begun like this comes to, without what it waits for."""
    status = axis.status
    match admission:
        case Admission.QUEUE:
            return predict(tools.config, request, _end_of_last(axis))
        case Admission.REPLACE:
            return predict(tools.config, request, _rest(axis, tools))
        case Admission.AT_ONCE | Admission.TAKE_OVER:
            return predict(tools.config, request, status.position, status.velocity or 0)


def starting_point(axis: AxisBody, on_busy: OnBusy) -> int | None:
    """Where a command would begin, steps; None: it isn't known well enough to refuse anything for it."""
    admission = _as_if(axis, on_busy)
    if admission is Admission.QUEUE:
        return _end_of_last(axis)
    return (axis.status.position or 0) if admission is Admission.AT_ONCE else None


def _as_if(axis: AxisBody, on_busy: OnBusy) -> Admission:
    """How it would begin if nothing else prevented it."""
    if on_busy is OnBusy.QUEUE and axis.last is not None:
        return Admission.QUEUE
    busy = axis.last is not None or axis.status.moving
    return Admission.REPLACE if on_busy is OnBusy.REPLACE and busy else Admission.AT_ONCE


def _end_of_last(axis: AxisBody) -> int | None:
    last = axis.last
    return None if last is None or last.prediction is None else last.prediction.end


def _rest(axis: AxisBody, tools: AxisTools) -> int | None:
    """Where a stop brings the axis to stand."""
    status = axis.status
    if status.position is None:
        return None
    return predict_rest(
        status.position, status.velocity or 0, gentlest_ramp(tools), tools.config.end_velocity
    )


def _target(request: Request, prediction: Prediction | None) -> int | None:
    """What the limits are asked about before it begins, steps; None: nothing, or it isn't known yet.

    Where its way leads through doesn't count: an axis beyond its limits may move back.
    """
    aims = isinstance(request, MoveRequest) or (
        isinstance(request, VelocityRequest) and request.travel is not None
    )
    return prediction.end if aims and prediction is not None else None


def _needed(tools: AxisTools, request: Request) -> dict[Parameter, int]:
    match request:
        case MoveRequest():
            return profile_position.parameters(tools.config, request)
        case VelocityRequest():
            needed = profile_velocity.parameters(tools.config, request)
            standing = request.travel is None and not profile_velocity.in_velocity(tools.drive)
            return needed | ({(objects.TARGET_VELOCITY, 0): 0} if standing else {})
        case HomeRequest():
            return homing.parameters(tools.config, request)
        case _:
            return {}
