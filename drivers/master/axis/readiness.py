"""What prevents a command now: every obstacle with its remedy, and the error that fits the gravest."""

from __future__ import annotations

from drivers.errors import AxisBusy, BusDown, CanaxisError, Gravity, NodeAway, NotReady, Obstacle, StopLatched
from drivers.master.axis.body import AxisBody
from drivers.master.axis.commands import AxisCommand, Question
from drivers.master.axis.obstacle_rows import ROWS

_ERRORS: dict[Gravity, type[NotReady]] = {
    Gravity.BUSY: AxisBusy,
    Gravity.ORDINARY: NotReady,
    Gravity.LATCHED: StopLatched,
}


def obstacles(
    axis: AxisBody, command: AxisCommand, *, absolute: bool = True, method: int | None = None
) -> tuple[Obstacle, ...]:
    """Everything that prevents `command` now, in the order in which it is best taken away; empty: it may be
    given.

    `absolute` matters for a move, `method` (None: the configured one) for a homing. A stop is never
    prevented.
    """
    return answer(axis, Question.about(command, absolute=absolute, method=method))


def answer(axis: AxisBody, question: Question) -> tuple[Obstacle, ...]:
    """The same as `obstacles`, for just this command."""
    found = (row.look(axis, question) for row in ROWS)
    return tuple(obstacle for obstacle in found if obstacle is not None)


def refusal(axis: AxisBody, command: AxisCommand, found: tuple[Obstacle, ...]) -> CanaxisError:
    """The error for these obstacles (at least one): the wire before the node before the latch before the
    rest.
    """
    node, number = axis.node.node_id, axis.number
    gravest = max(obstacle.gravity for obstacle in found)
    reasons = " ".join(obstacle.message for obstacle in found)
    remedies = " ".join(obstacle.remedy for obstacle in found)
    message = f"Axis {axis.name} can't do {command} now: {reasons}"
    if gravest is Gravity.BUS_DOWN:
        return BusDown(message, hint=remedies, node=node, axis=number)
    if gravest is Gravity.AWAY:
        return NodeAway(message, hint=remedies, node=node, axis=number)
    return _ERRORS[gravest](message, obstacles=found, node=node, axis=number)
