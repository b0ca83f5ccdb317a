"""Several axes on a straight line: each gets the same profile over time, scaled by its distance.

The slowest axis decides. Speeds and accelerations are whole numbers, and VSTOP doesn't scale, so each axis's
numbers are chosen from around the scaled ones such that its ramp, by the module's arithmetic (manual §1.5),
takes as long as that of the others. It is a trapezoid (V1 = V2 = 0) from standstill (VSTART = 0) with the
lowest VSTOP that the manual allows, whatever the axis's own shape is: those speeds are never scaled by the
module, and a slow axis would jump to all of its speed.

With d the way, v the speed, e VSTOP (no more than v), a and b the rates up and down, a ramp that reaches its
speed takes  d/v + v/2a + (v-e)^2/2vb  seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drivers.errors import BadValue

END_VELOCITY = 10
"""VSTOP (6082h) of every axis, steps/s: a lower one might not reach its target."""
CLOSE = 0.002
"""Seconds that an axis may miss the common time by before its numbers are sought further afield."""
_REACHES = (1, 3, 8)
"""How far from the scaled numbers they are sought, one after the other."""
_HALVINGS = 40
_LATE = 1000
"""How much worse it is to arrive after the others than before them."""


@dataclass(frozen=True, slots=True)
class Way:
    """What one axis has before it, and what it may do at most. Steps, steps/s, steps/s2."""

    distance: int
    """Without direction; at least 1."""
    velocity: int
    acceleration: int
    deceleration: int

    def duration(self, velocity: float, acceleration: float, deceleration: float) -> float:
        """Seconds from the first step to standstill, with at most these."""
        speed = min(velocity, self._peak(acceleration, deceleration))
        up, down = speed**2 / acceleration, (speed - min(END_VELOCITY, speed)) ** 2 / deceleration
        return (self.distance + (up + down) / 2) / speed

    def velocity_for(self, seconds: float, acceleration: float, deceleration: float) -> float:
        """The speed with which it takes that long, as near as a speed gets to it."""
        low, high = 0.0, self._peak(acceleration, deceleration)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if self.duration(middle, acceleration, deceleration) > seconds:
                low = middle
            else:
                high = middle
        return high

    def deceleration_for(self, seconds: float, velocity: float, acceleration: float) -> float:
        """The rate down with which it takes that long, as near as a rate gets to it."""
        low, high = 0.0, float(self.deceleration)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if self.duration(velocity, acceleration, middle) > seconds:
                low = middle
            else:
                high = middle
        return high

    @property
    def longest(self) -> float:
        """Seconds that it takes at the lowest speed there is, 1 step/s."""
        return self.duration(1, 1, 1)

    def _peak(self, acceleration: float, deceleration: float) -> float:
        """The speed that it reaches where none limits it."""
        square = 2 * self.distance + END_VELOCITY**2 / deceleration
        peak = math.sqrt(square / (1 / acceleration + 1 / deceleration))
        return peak if peak >= END_VELOCITY else math.sqrt(2 * acceleration * self.distance)


@dataclass(frozen=True, slots=True)
class Profile:
    """What one axis is told: never more than its `Way` allows."""

    velocity: int
    """6081h, steps/s"""
    acceleration: int
    """6083h, steps/s2"""
    deceleration: int
    """6084h, steps/s2"""
    duration_s: float
    """From the start to standstill."""


@dataclass(frozen=True, slots=True)
class Coordination:
    """The common time, and what each axis is told for it."""

    duration_s: float
    profiles: tuple[Profile, ...]
    """In the order of the ways."""

    @property
    def spread_s(self) -> float:
        """Between the first arrival and the last, as far as numbers tell. Some steps in many seconds is a way
        that 1 step/s covers too soon; such an axis arrives before the others.
        """
        ends = [profile.duration_s for profile in self.profiles]
        return max(ends) - min(ends)


def coordinate(ways: Sequence[Way], at_least: float = 0.0) -> Coordination:
    """Have all of them (one at least) take the same time: as short as they allow, or `at_least` seconds.

    Raises `BadValue` for a time in which even the longest way ends too soon.
    """
    velocity = min(way.velocity / way.distance for way in ways)
    acceleration = min(way.acceleration / way.distance for way in ways)
    deceleration = min(way.deceleration / way.distance for way in ways)

    def scaled(slower: float) -> list[tuple[float, float, float]]:
        return [
            (
                velocity * way.distance * slower,
                acceleration * way.distance * slower**2,
                deceleration * way.distance * slower**2,
            )
            for way in ways
        ]

    ideals = scaled(1.0)
    seconds = max(way.duration(*ideal) for way, ideal in zip(ways, ideals, strict=True))
    if at_least > seconds:
        if at_least > (most := max(way.longest for way in ways)):
            raise BadValue(
                f"No axis can take {at_least:g} s for its way: at 1 step/s the longest takes {most:g} s.",
                hint="Give a shorter duration_s.",
            )
        ideals = scaled(seconds / at_least)
        seconds = at_least
    return Coordination(
        seconds, tuple(_fitted(way, seconds, *ideal) for way, ideal in zip(ways, ideals, strict=True))
    )


def _fitted(way: Way, seconds: float, velocity: float, acceleration: float, deceleration: float) -> Profile:
    """The whole numbers that come close to the time, and of those the ones nearest to the scaled."""
    if seconds >= way.longest:
        return Profile(1, 1, 1, way.longest)

    def badness(profile: Profile) -> tuple[float, float]:
        late = profile.duration_s - seconds
        late = late * _LATE if late > CLOSE else abs(late)
        off = (
            abs(profile.velocity / velocity - 1)
            + abs(profile.acceleration / acceleration - 1)
            + abs(profile.deceleration / deceleration - 1)
        )
        return max(late, CLOSE), off

    best = min(_candidates(way, seconds, velocity, acceleration, deceleration, _REACHES[0]), key=badness)
    for reach in _REACHES[1:]:
        if badness(best)[0] <= CLOSE:
            break
        best = min(_candidates(way, seconds, velocity, acceleration, deceleration, reach), key=badness)
    if badness(best)[0] > CLOSE:
        best = min((best, *_gentle_candidates(way, seconds)), key=badness)
    return best


def _candidates(
    way: Way, seconds: float, velocity: float, acceleration: float, deceleration: float, reach: int
) -> Iterator[Profile]:
    """Where the scaled speed is never reached, the rate down makes up for what the rate up was rounded by;
    else the speed does too.
    """
    down = max(1.0, min(deceleration, way.deceleration))
    unreached = min(way.velocity, math.ceil(velocity))
    for up in _near(acceleration, reach, way.acceleration):
        speeds = _near(way.velocity_for(seconds, up, down), reach, way.velocity)
        for speed in (unreached, *speeds):
            for rate in _near(way.deceleration_for(seconds, speed, up), 1, way.deceleration):
                yield Profile(speed, up, rate, way.duration(speed, up, rate))


def _gentle_candidates(way: Way, seconds: float) -> Iterator[Profile]:
    """A speed of some tens of steps/s is too coarse: one above it, and ramps that last as much longer."""
    lowest = math.floor(way.distance / seconds) + 1
    for speed in range(min(lowest, way.velocity), min(lowest + _REACHES[-1], way.velocity + 1)):
        left = seconds - way.distance / speed
        if left > 0:
            both = (speed**2 + (speed - min(speed, END_VELOCITY)) ** 2) / (2 * speed * left)
            for up in _near(both, _REACHES[-1], way.acceleration):
                for rate in _near(way.deceleration_for(seconds, speed, up), 1, way.deceleration):
                    yield Profile(speed, up, rate, way.duration(speed, up, rate))


def _near(value: float, reach: int, highest: int) -> range:
    """The whole numbers around a value, from 1 to the highest allowed."""
    middle = min(max(1, math.floor(min(value, highest))), highest)
    return range(max(1, middle - reach + 1), min(highest, middle + reach) + 1)
