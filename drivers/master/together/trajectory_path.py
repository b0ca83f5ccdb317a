"""A path through time-stamped points, and the set points that a cycle makes of it. Pure.

Between two points that both have velocities the path is their cubic Hermite polynomial: it passes through
both, with those velocities, so the whole has no corner. Between any others it is a straight line, and the
velocity jumps at the points. Everything is in steps and seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

_SAME = 1e-9
"""Seconds that arithmetic may cost."""


class Point(NamedTuple):
    """Where every axis is at a time."""

    time: float
    """Seconds; the first point's time is the beginning, whatever it is."""
    positions: tuple[float, ...]
    """steps"""
    velocities: tuple[float, ...] | None = None
    """steps/s"""


class Sample(NamedTuple):
    """What a cycle sends."""

    point: int
    """The number of the point that it leads to, counted from 0."""
    time: float
    """Seconds since the beginning of the path."""
    row: tuple[float, ...]
    """steps"""


def between(first: Point, second: Point, time: float) -> tuple[float, ...]:
    """Where the path is at a time from the first to the second point, both included."""
    span = second.time - first.time
    share = (time - first.time) / span
    if first.velocities is None or second.velocities is None:
        return tuple(a + (b - a) * share for a, b in zip(first.positions, second.positions, strict=True))
    rest = 1.0 - share
    from_a = rest * rest * (1.0 + 2.0 * share)
    from_b = share * share * (3.0 - 2.0 * share)
    by_a = share * rest * rest * span
    by_b = -share * share * rest * span
    return tuple(
        from_a * a + from_b * b + by_a * va + by_b * vb
        for a, b, va, vb in zip(
            first.positions, second.positions, first.velocities, second.velocities, strict=True
        )
    )


def samples(points: Iterable[Point], period: float) -> Iterator[Sample]:
    """One for each cycle, from the first point's time to the last point itself.

    A path that doesn't end with a cycle ends with the next one, on its last point. Times must rise.
    """
    rising = iter(points)
    first = next(rising, None)
    if first is None:
        return
    begin = first.time
    yield Sample(0, 0.0, first.positions)
    cycle, number = 1, 0
    for number, second in enumerate(rising, start=1):
        while (time := cycle * period) <= second.time - begin - _SAME:
            yield Sample(number, time, between(first, second, begin + time))
            cycle += 1
        first = second
    if number:
        yield Sample(number, cycle * period, first.positions)


def cycles(duration: float, period: float) -> int:
    """How many set points a path of that many seconds has, the first one included."""
    return 1 + max(0, math.ceil((duration - _SAME) / period))
