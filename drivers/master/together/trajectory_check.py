"""Whether the axes can follow a path: looked at as a whole, at the cycle, before anything moves. Pure.

Speeds and accelerations are those of the set points that will be sent, before they are rounded to steps: so
a corner between two straight lines is an acceleration of the whole change within one cycle, as it is for the
motor, which has no ramp of its own in csp.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from drivers.errors import BadValue, TrajectoryRefused
from drivers.master.axis.axis import Axis
from drivers.master.plan.configuration import HIGHEST_RATE
from drivers.master.together.trajectory_path import Point, Sample, samples

_RELATIVE = 1e-6
_ABSOLUTE = 1e-3
"""By how much a limit may be passed, relative and in steps: arithmetic, no more."""
START_STEPS = 1.0
"""How far from the first point an axis may stand, steps: what rounding in another unit costs."""


@dataclass(slots=True)
class Peaks:
    """The extremes of one axis, in steps and seconds."""

    speed: float = 0.0
    acceleration: float = 0.0
    lowest: float = math.inf
    highest: float = -math.inf


@dataclass(slots=True)
class Survey:
    """What a path comes to."""

    points: int = 0
    cycles: int = 0
    """Set points."""
    duration_s: float = 0.0
    peaks: list[Peaks] = field(default_factory=list[Peaks])
    end: tuple[float, ...] = ()
    """steps"""


def survey(points: Iterable[Point], period: float, axes: Sequence[Axis]) -> Survey:
    """Look at the whole path. Raises `TrajectoryRefused`, `BadValue`. Takes its time: see `samples`.

    The path must begin where the axes stand, and end at rest.
    """
    found = Survey(peaks=[Peaks() for _ in axes])
    looks = [_Look(axis, period, peaks) for axis, peaks in zip(axes, found.peaks, strict=True)]
    last: Sample | None = None
    for sample in samples(_counted(points, found), period):
        for look, target in zip(looks, sample.row, strict=True):
            look.take(target, sample)
        last = sample
        found.cycles += 1
    if last is None or found.points < 2:
        raise BadValue("A trajectory has two points at least.", hint="Give more points.")
    for look, target in zip(looks, last.row, strict=True):
        look.take(target, last)  # a cycle later it stands
    found.end = last.row
    return found


def _counted(points: Iterable[Point], found: Survey) -> Iterator[Point]:
    begin, before = 0.0, -math.inf
    for point in points:
        if not point.time > before:
            raise TrajectoryRefused(
                f"Point {found.points}: its time {point.time:g} s is not after the one before.",
                hint="Give the points in the order of their times.",
                point=found.points,
                time_s=point.time,
                quantity="time",
                value=point.time,
                limit=before,
            )
        if found.points == 0:
            begin = point.time
        before = point.time
        found.points += 1
        found.duration_s = point.time - begin
        yield point


def _limit(most: int, usual: int) -> int:
    """The axis's maximum where one is set; else what it moves with."""
    return most if most < HIGHEST_RATE else usual


class _Look:
    """One axis's set points, one after the other."""

    def __init__(self, axis: Axis, period: float, peaks: Peaks) -> None:
        config = axis.config
        self._axis = axis
        self._name = f"{axis.node.name}.{axis.name}"
        self._period = period
        self._peaks = peaks
        self._low, self._high = config.target_range
        self._speed = _limit(config.max_velocity, config.velocity)
        self._acceleration = _limit(config.max_acceleration, config.acceleration)
        self._deceleration = _limit(config.max_acceleration, config.deceleration)
        self._at: float | None = None
        self._change = 0.0

    def take(self, target: float, sample: Sample) -> None:
        """The next set point."""
        peaks = self._peaks
        if self._at is None:
            self._begin(target, sample)
        if not self._low <= target <= self._high:
            limit = self._low if target < self._low else self._high
            raise self._refused(
                sample, "position", "steps", target, limit, "Stay within the axis's travel limits."
            )
        assert self._at is not None
        change = target - self._at
        allowed = self._speed * self._period
        if abs(change) > allowed * (1 + _RELATIVE) + _ABSOLUTE:
            raise self._refused(
                sample,
                "velocity",
                "steps/s",
                change / self._period,
                self._speed,
                "Give the way more time, or raise the axis's velocity.",
            )
        rising = abs(change) >= abs(self._change)
        most = self._acceleration if rising else self._deceleration
        second = abs(change - self._change)
        if second > most * self._period**2 * (1 + _RELATIVE) + _ABSOLUTE * self._period:
            raise self._refused(
                sample,
                "acceleration" if rising else "deceleration",
                "steps/s2",
                second / self._period**2,
                most,
                "Round the corners (points with velocities), begin and end at rest, give positions with "
                "more digits or points further apart, or raise the axis's acceleration.",
            )
        peaks.speed = max(peaks.speed, abs(change) / self._period)
        peaks.acceleration = max(peaks.acceleration, second / self._period**2)
        peaks.lowest = min(peaks.lowest, target)
        peaks.highest = max(peaks.highest, target)
        self._at, self._change = target, change

    def _begin(self, target: float, sample: Sample) -> None:
        position = self._axis.status.position
        stands = 0 if position is None else position
        if abs(target - stands) > START_STEPS + self._axis.config.position_tolerance:
            raise self._refused(
                sample,
                "start",
                "steps",
                target,
                stands,
                "Move the axes to the first point, then send the trajectory.",
            )
        self._at = target

    def _refused(
        self, sample: Sample, quantity: str, unit: str, value: float, limit: float, hint: str
    ) -> TrajectoryRefused:
        says = (
            f"it stands at {limit:.10g}, but the path begins at {value:.10g} {unit}"
            if quantity == "start"
            else f"{quantity} {value:.10g} {unit} is beyond {limit:.10g}"
        )
        return TrajectoryRefused(
            f"Axis {self._name}, on the way to point {sample.point} ({sample.time:.6g} s): {says}.",
            hint=hint,
            point=sample.point,
            time_s=sample.time,
            quantity=quantity,
            value=value,
            limit=limit,
            node=self._axis.node.node_id,
            axis=self._axis.number,
        )
