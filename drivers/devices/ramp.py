"""Ramps in closed form, as the modules make them: EightPoint, trapezoid, velocity, stop, cyclic set points.

For predictions, and for the simulated module. Each `plan_*` gives one leg in one direction. Where a leg
can't reach its goal because the motor runs the wrong way or too fast, the leg is a stop ramp: the caller
waits out the ramp wait time at its end and plans again.

All in microsteps, microsteps/s, microsteps/s2, seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from drivers.devices.trajectory import Segment, Trajectory, rest


@dataclass(frozen=True, slots=True)
class Band:
    """An acceleration that holds for speeds from `low` to `high`."""

    low: float
    high: float
    rate: float

    def distance(self) -> float:
        """Way on which the speed goes from one limit to the other."""
        return (self.high**2 - self.low**2) / (2.0 * self.rate)


def bands(v1: float, v2: float, rate1: float, rate2: float, rate_max: float) -> tuple[Band, ...]:
    """The three accelerations of the EightPoint ramp over the speed (manual §1.5).

    V1 = V2 = 0 is the trapezoid. With only V1 = 0 the first band is empty; with V2 <= V1, 0 too, the second
    one is: unverified on hardware.
    """
    upper = max(v1, v2)
    rows = (Band(0.0, v1, rate1), Band(v1, upper, rate2), Band(upper, math.inf, rate_max))
    return tuple(band for band in rows if band.high > band.low)


@dataclass(frozen=True, slots=True)
class Ramp:
    """What shapes a positioning."""

    start_speed: float
    """VSTART: the speed jumps to it from rest."""
    stop_speed: float
    """VSTOP: the speed jumps from it to 0 at the target."""
    max_speed: float
    """VMAX."""
    up: tuple[Band, ...]
    down: tuple[Band, ...]

    @classmethod
    def trapezoid(
        cls,
        max_speed: float,
        acceleration: float,
        deceleration: float,
        start_speed: float = 0,
        stop_speed: float = 0,
    ) -> Ramp:
        """A plain ramp: the same acceleration, and the same deceleration, over all speeds."""
        return cls(
            start_speed,
            stop_speed,
            max_speed,
            bands(0, 0, 0, 0, acceleration),
            bands(0, 0, 0, 0, deceleration),
        )

    @property
    def complete(self) -> bool:
        """Whether no speed or rate that a move needs is zero. With one that is, no move runs."""
        return self.max_speed > 0 and all(band.rate > 0 for band in (*self.up, *self.down))


def plan_move(start: float, origin: float, velocity: float, target: int, ramp: Ramp) -> Trajectory:
    """The leg towards `target` from a position and velocity; `ramp` must be complete.

    It ends on the target at rest; or, if the motor runs away from it or can't stop before it, it is the ramp
    down to standstill. From rest, a VSTART above what can be stopped on the way is lowered.
    """
    distance = target - origin
    way = abs(distance)
    sign = math.copysign(1.0, distance)
    speed = velocity * sign
    if not way and not velocity:
        return rest(start, origin)
    stop_speed = min(ramp.stop_speed, ramp.max_speed)
    if velocity and (speed < 0 or _way(ramp.down, stop_speed, speed) > way):
        return _ramp_down(start, origin, velocity, ramp.down, ramp.stop_speed)
    first = speed if velocity else min(ramp.start_speed, ramp.max_speed)
    if first > ramp.max_speed:
        peak = ramp.max_speed
        before = _slower(ramp.down, peak, first)
        cruise = way - _way(ramp.down, stop_speed, first)
    else:
        peak = _peak(ramp, first, stop_speed, way)
        before = _faster(ramp.up, first, peak)
        cruise = way - _way(ramp.up, first, peak) - _way(ramp.down, stop_speed, peak)
    segments = [*before]
    if cruise > 0 and peak > 0:
        segments.append(Segment(cruise / peak, peak, 0.0))
    segments += _slower(ramp.down, stop_speed, peak)
    return Trajectory(start, origin, _signed(segments, sign), end=float(target))


def plan_velocity(
    start: float,
    origin: float,
    velocity: float,
    target: float,
    rate: float,
    start_speed: float = 0.0,
    stop_speed: float = 0.0,
) -> Trajectory:
    """The leg towards a velocity, with the same `rate` (> 0) up and down.

    From rest the speed jumps to `start_speed`, or to the target if that is less. Towards 0 or the other
    direction it is a stop ramp from which the speed jumps to 0 at `stop_speed`.
    """
    if not target or velocity * target < 0:
        return plan_stop(start, origin, velocity, rate, stop_speed)
    sign = math.copysign(1.0, target)
    first = abs(velocity) if velocity else min(start_speed, abs(target))
    change = abs(target) - first
    segments = [Segment(abs(change) / rate, first, math.copysign(rate, change))] if change else []
    signed = _signed(segments, sign)
    end = origin + sum(segment.travelled(segment.duration) for segment in signed)
    return Trajectory(start, origin, signed, end=end, final_velocity=target)


def plan_stop(
    start: float, origin: float, velocity: float, rate: float, stop_speed: float = 0.0
) -> Trajectory:
    """The ramp down to standstill. A rate of 0 stops at once (unverified on hardware)."""
    if not rate:
        return Trajectory(start, origin, end=whole_step(origin, velocity))
    return _ramp_down(start, origin, velocity, bands(0, 0, 0, 0, rate), stop_speed)


def plan_follow(start: float, origin: float, target: int, period: float) -> Trajectory:
    """csp: the target is reached within the period at constant speed, without a ramp (manual §9)."""
    if target == origin:
        return rest(start, origin)
    return Trajectory(start, origin, (Segment(period, (target - origin) / period, 0.0),), end=float(target))


def whole_step(position: float, velocity: float) -> float:
    """The microstep on which a motor comes to rest: the next one in its direction."""
    if not velocity:
        return float(round(position))
    return float(math.ceil(position - 1e-6) if velocity > 0 else math.floor(position + 1e-6))


def _ramp_down(
    start: float, origin: float, velocity: float, down: tuple[Band, ...], stop_speed: float
) -> Trajectory:
    segments = _signed(
        _slower(down, min(stop_speed, abs(velocity)), abs(velocity)), math.copysign(1.0, velocity)
    )
    end = origin + sum(segment.travelled(segment.duration) for segment in segments)
    return Trajectory(start, origin, segments, end=whole_step(end, velocity))


def _peak(ramp: Ramp, first: float, stop_speed: float, way: float) -> float:
    """The highest speed on a way: over the square of the speed, the ways up and down are piecewise linear."""
    taken = _way(ramp.down, stop_speed, first)
    if taken > way:
        return _speed_after(ramp.down, stop_speed, way)
    edges = sorted(
        {
            first,
            ramp.max_speed,
            *(
                edge
                for edge in (stop_speed, *(band.low for band in (*ramp.up, *ramp.down)))
                if first < edge < ramp.max_speed
            ),
        }
    )
    for low, high in pairwise(edges):
        step = _way(ramp.up, low, high) + _way(ramp.down, max(low, stop_speed), high)
        if taken + step >= way:
            share = (way - taken) / step
            return math.sqrt(low**2 + share * (high**2 - low**2))
        taken += step
    return ramp.max_speed


def _speed_after(rows: tuple[Band, ...], low: float, way: float) -> float:
    """The speed from which `way` suffices to come down to `low`."""
    for band in _clipped(rows, low, math.inf):
        step = band.distance()
        if step >= way:
            return math.sqrt(band.low**2 + 2.0 * band.rate * way)
        way -= step
    raise AssertionError("the last band has no upper limit")


def _clipped(rows: Sequence[Band], low: float, high: float) -> Iterable[Band]:
    for band in rows:
        clipped = Band(max(band.low, low), min(band.high, high), band.rate)
        if clipped.low < clipped.high:
            yield clipped


def _way(rows: Sequence[Band], low: float, high: float) -> float:
    return sum(band.distance() for band in _clipped(rows, low, high))


def _faster(rows: Sequence[Band], low: float, high: float) -> list[Segment]:
    return [
        Segment((band.high - band.low) / band.rate, band.low, band.rate) for band in _clipped(rows, low, high)
    ]


def _slower(rows: Sequence[Band], low: float, high: float) -> list[Segment]:
    found = [
        Segment((band.high - band.low) / band.rate, band.high, -band.rate)
        for band in _clipped(rows, low, high)
    ]
    found.reverse()
    return found


def _signed(segments: Iterable[Segment], sign: float) -> tuple[Segment, ...]:
    return tuple(Segment(s.duration, s.velocity * sign, s.acceleration * sign) for s in segments)
