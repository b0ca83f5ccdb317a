"""Whether axes may move together: every one of them with all that prevents it, in one error."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from drivers.errors import (
    AxisBusy,
    BadValue,
    BusDown,
    CanaxisError,
    Gravity,
    NodeAway,
    NotReady,
    Obstacle,
    StopLatched,
)
from drivers.master.axis.commands import AxisCommand
from drivers.master.axis.readiness import obstacles, refusal
from drivers.master.motions.motion import Operation
from drivers.master.together.member import Member

SYNC_USER = "the start of a coordinated move"
"""By which a group claims the SYNC of the bus."""


def require_ready(
    members: Sequence[Member], *, replace: bool = False, expected: Operation | None = None
) -> None:
    """Raise for all axes at once what a move of each would raise, and what `check_request` does.

    `replace`: what an axis is doing counts not, since it is stopped first; a coming to rest does. `expected`:
    what the axes take part in already.
    """
    check_request(members)
    refused = [
        refusal(member.axis, AxisCommand.MOVE, found)
        for member in members
        if (found := hindrances(member, replace=replace, expected=expected))
    ]
    if refused:
        raise merged(refused)


def check_request(members: Sequence[Member]) -> None:
    """Raise `BadValue` for no axes, one that is named twice, several buses, or targets beyond limits."""
    axes = [member.axis for member in members]
    if not axes:
        raise BadValue("No axis is named.", hint="Name the axes that are to move.")
    if len(set(axes)) != len(axes):
        raise BadValue("An axis is named twice.", hint="Name each axis once.")
    if len({axis.backbone for axis in axes}) != 1:
        raise BadValue("The axes are on different buses.", hint="Only axes of one bus share a SYNC.")
    bad: list[CanaxisError] = []
    for member in members:
        try:
            member.check()
        except BadValue as error:
            bad.append(error)
    if bad:
        raise merged(bad)


def hindrances(
    member: Member, *, replace: bool = False, expected: Operation | None = None
) -> tuple[Obstacle, ...]:
    """What prevents one axis from taking part: see `require_ready`."""
    axis = member.axis
    found = obstacles(axis, AxisCommand.MOVE, absolute=not member.request.relative)
    runs = axis.motion is not None or (axis.errand is None and axis.status.moving)
    mine = expected is not None and axis.motion is expected
    if (replace and runs) or (mine and axis.errand is not None):
        found = tuple(obstacle for obstacle in found if obstacle.gravity is not Gravity.BUSY)
    sync = axis.backbone.sync
    return found if sync.user == SYNC_USER else (*found, *sync.obstacles())  # a start takes milliseconds


def merged(errors: Sequence[CanaxisError]) -> CanaxisError:
    """One error (of at least one) that names every axis: of the gravest kind, with all obstacles."""
    if len(errors) == 1:
        return errors[0]
    message = " ".join(error.message for error in errors)
    hint = " ".join(dict.fromkeys(error.hint for error in errors if error.hint))
    for kind in (BusDown, NodeAway):
        worst = [error for error in errors if isinstance(error, kind)]
        if worst:
            return kind(message, hint=hint, node=worst[0].node, axis=worst[0].axis)
    not_ready = [error for error in errors if isinstance(error, NotReady)]
    if len(not_ready) == len(errors):
        named = tuple(
            dataclasses.replace(o, message=f"{_name(error)}: {o.message}", action=None)
            for error in not_ready
            for o in error.obstacles
        )
        latched = any(isinstance(error, StopLatched) for error in errors)
        busy = all(isinstance(error, AxisBusy) for error in errors)
        refused: type[NotReady] = StopLatched if latched else AxisBusy if busy else NotReady
        return refused(message, obstacles=named, hint=hint, node=errors[0].node, axis=errors[0].axis)
    first = errors[0]
    first.message, first.hint = message, hint
    return first


def _name(error: CanaxisError) -> str:
    return f"Node {error.node} axis {error.axis}"
