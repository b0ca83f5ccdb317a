"""What a coordinated move will come to: the common time, each axis's profile, and what prevents it now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import Obstacle
from drivers.master.axis.axis import Axis
from drivers.master.plan.prediction import Prediction
from drivers.master.plan.requests import MoveRequest
from drivers.master.together.coordination import Coordination, coordinate
from drivers.master.together.hindrances import check_request, hindrances
from drivers.master.together.member import Member


@dataclass(frozen=True, slots=True)
class CoordinatedPrediction:
    """A coordinated move that was not commanded: nothing was sent."""

    coordination: Coordination
    members: tuple[Member, ...]
    hindrances: tuple[tuple[Axis, tuple[Obstacle, ...]], ...]
    """What prevents it now, of each axis that something prevents."""

    @classmethod
    def of(
        cls, moves: Sequence[tuple[Axis, MoveRequest]], *, at_least: float = 0.0, replace: bool = False
    ) -> CoordinatedPrediction:
        """From where the axes were seen last. Raises `BadValue` for what no state of the axes would allow."""
        members = tuple(Member(axis, request) for axis, request in moves)
        check_request(members)
        found = ((member.axis, hindrances(member, replace=replace)) for member in members)
        return cls(planned(members, at_least), members, tuple(entry for entry in found if entry[1]))


def planned(members: Sequence[Member], at_least: float) -> Coordination:
    """Give every member that has a way to go its profile. Raises `BadValue` for a time that can't be kept."""
    moving = [member for member in members if member.moves]
    for member in members:
        member.profile = None
    if not moving:
        return Coordination(0.0, ())
    coordination = coordinate([member.way for member in moving], at_least)
    for member, profile in zip(moving, coordination.profiles, strict=True):
        member.profile = profile
    return coordination


def expected(coordination: Coordination, members: Sequence[Member]) -> Prediction:
    """The whole of it; of one axis alone also from where to where."""
    alone = members[0] if len(members) == 1 else None
    return Prediction(
        coordination.duration_s,
        float(max((profile.velocity for profile in coordination.profiles), default=0)),
        None if alone is None else alone.start,
        None if alone is None else alone.target,
    )
