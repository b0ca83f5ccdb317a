"""What becomes of a moving command for an axis: at once, in another's place, or behind it. Nothing is sent.

It can be asked of several axes before any of them is touched.
"""

from __future__ import annotations

import enum

from drivers import obstacles as kinds
from drivers.errors import Gravity, LineFull, Obstacle
from drivers.master.axis.body import AxisBody
from drivers.master.axis.commands import Question
from drivers.master.axis.errands import MOTIONS, ErrandName
from drivers.master.axis.readiness import answer, refusal
from drivers.master.axis.waiting_line import LONGEST
from drivers.master.motions.motion import Motion, MotionKind
from drivers.master.plan.requests import (
    JogRequest,
    OnBusy,
    Request,
    VelocityRequest,
)

_REFERENCING = frozenset({MotionKind.HOME, MotionKind.SET_POSITION})


class Admission(enum.StrEnum):
    """How a command that may be given is begun."""

    AT_ONCE = "at_once"
    TAKE_OVER = "take_over"
    """One velocity goes over into another, without a stop."""
    REPLACE = "replace"
    """What runs is cancelled; it begins once the axis stands."""
    QUEUE = "queue"
    """It begins once everything before it has succeeded."""


def look(
    axis: AxisBody, question: Question, on_busy: OnBusy
) -> tuple[Admission | None, tuple[Obstacle, ...]]:
    """How the command would be begun now, or (None) what prevents it.

    A stop, an enabling and the like are no operations: nothing replaces them or waits behind them.
    """
    found = answer(axis, question)
    over = axis.errand is ErrandName.TURNING and not question.from_rest
    last = axis.last
    if not found and (on_busy is not OnBusy.QUEUE or last is None):
        return (Admission.TAKE_OVER if over else Admission.AT_ONCE), ()
    others = tuple(obstacle for obstacle in found if obstacle.gravity is not Gravity.BUSY)
    if on_busy is OnBusy.REPLACE and not others and _replaceable(axis):
        return (Admission.TAKE_OVER if over else Admission.REPLACE), ()
    if on_busy is not OnBusy.QUEUE or last is None:
        return None, found
    if any(motion.kind in _REFERENCING for motion in (axis.motion, *axis.queued) if motion is not None):
        others = tuple(obstacle for obstacle in others if obstacle.code != "not_referenced")
    if isinstance(last.request, JogRequest) or (
        isinstance(last.request, VelocityRequest) and last.request.endless
    ):
        others = (*others, _ENDLESS)
    if others:
        return None, others
    if len(axis.queued) >= LONGEST:
        return None, (_full(axis),)
    return Admission.QUEUE, ()


def admit(axis: AxisBody, request: Request, on_busy: OnBusy) -> Admission:
    """How the command is to be begun. Raises, as `Axis.move_to` says, where it may not be given."""
    question = Question.of(request)
    admission, found = look(axis, question, on_busy)
    if admission is not None:
        return admission
    if found[0].code == kinds.QUEUE_FULL.code:
        raise LineFull(
            found[0].message,
            obstacles=found,
            frees_in_s=_left(axis),
            node=axis.node.node_id,
            axis=axis.number,
        )
    raise refusal(axis, question.command, found)


def _full(axis: AxisBody) -> Obstacle:
    return kinds.QUEUE_FULL.found(f"{LONGEST} operations wait for axis {axis.name} already.")


def _left(axis: AxisBody) -> float:
    """Seconds until what runs ends, as far as that can be told; at least 1."""
    motion = axis.motion
    if motion is None or motion.prediction is None:
        return 1.0
    return max(1.0, motion.prediction.duration_s * (1.0 - (motion.progress or 0.0)))


def _replaceable(axis: AxisBody) -> bool:
    if axis.configuring or not isinstance(axis.motion, Motion | None):
        return False  # what several axes do is not one axis's to replace
    return axis.errand is None or axis.errand in MOTIONS or axis.making_way


_ENDLESS = kinds.ENDLESS.found(
    "What it would wait for turns until something else is commanded, so nothing can come after it."
)
