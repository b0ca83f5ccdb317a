"""What several axes do together, as clients ask for it, and when it must have ended."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.master import Axis, MoveRequest, Network
from drivers.master.motions.motion import Operation
from drivers.master.together.trajectory import TrajectoryRequest, begin_trajectory
from drivers.master.together.trajectory_check import survey
from drivers.master.together.trajectory_file import PointFile

_POINT = 0.05
"""Seconds between two points of a path."""


@dataclass(frozen=True)
class Together:
    """One that was accepted."""

    operation: Operation
    goals: tuple[int | None, ...]
    """Where each axis must stand if it succeeds; None: that depends on where it came to rest before."""
    lasts: float
    """Seconds of the motion itself, at most."""

    def __str__(self) -> str:
        return f"{self.operation.kind} to {self.goals}"


def some_axes(rng: random.Random, axes: Sequence[Axis], first: Axis) -> list[Axis]:
    """`first` and one or two others, mostly of its node."""
    near = [axis for axis in axes if axis is not first and axis.node is first.node]
    others = near if rng.random() < 0.6 else [axis for axis in axes if axis is not first]
    return [first, *rng.sample(others, rng.choice((1, 2, 2)))]


def move_together(
    network: Network, rng: random.Random, axes: Sequence[Axis], speed: int, name: str
) -> Together:
    """A coordinated move. Raises what `Network.move_together` does."""
    replace = rng.random() < 0.3
    relative = [rng.random() < 0.4 for _ in axes]
    reach = [rng.choice((-20_000, -900, 0, 1, 4_000, 15_000)) for _ in axes]
    velocity, at_least = rng.choice((None, 9_000, speed)), rng.choice((0.0, 0.0, 1.5))
    standing = [None if axis.status.moving else axis.status.position for axis in axes]
    moves = [
        (axis, MoveRequest(way, relative=counted, velocity=velocity))
        for axis, way, counted in zip(axes, reach, relative, strict=True)
    ]
    group = network.move_together(moves, at_least=at_least, replace=replace, operation_id=name)
    goals = tuple(
        way if not counted else None if replace or here is None else here + way
        for way, counted, here in zip(reach, relative, standing, strict=True)
    )
    slowest = velocity or min(axis.config.velocity for axis in axes)
    gentlest = min(min(axis.config.acceleration, axis.config.deceleration) for axis in axes)
    return Together(group, goals, 200_000 / slowest + 2 * slowest / gentlest + at_least)


def follow(rng: random.Random, axes: Sequence[Axis], name: str) -> Together:
    """A path from where the axes stand. Raises what `begin_trajectory` does."""
    seconds, period_ms = rng.choice((0.4, 0.8)), rng.choice((10, 20))
    reach = [rng.choice((-2_000, -50, 0, 300, 2_500)) for _ in axes]
    starts = [axis.status.position or 0 for axis in axes]
    points = PointFile(len(axes))
    try:
        for number in range(round(seconds / _POINT) + 1):
            share = (1 - math.cos(math.pi * number * _POINT / seconds)) / 2
            slope = math.pi / (2 * seconds) * math.sin(math.pi * number * _POINT / seconds)
            points.add(
                number * _POINT,
                [start + share * way for start, way in zip(starts, reach, strict=True)],
                [slope * way for way in reach],
            )
        found = survey(points.points(), period_ms / 1000, axes)
        request = TrajectoryRequest(tuple(axes), points, period_ms, found)
        trajectory = begin_trajectory(request, operation_id=name)
    except BaseException:
        points.close()
        raise
    goals = tuple(start + way for start, way in zip(starts, reach, strict=True))
    return Together(trajectory, goals, seconds + 25.0)
