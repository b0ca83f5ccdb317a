"""A stretch of motion in one direction, in closed form: positions, velocities and when they occur."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Segment:
    """A piece of constant acceleration."""

    duration: float
    """Seconds, >= 0."""
    velocity: float
    """At its begin, microsteps/s, with sign."""
    acceleration: float
    """microsteps/s2, with sign."""

    def travelled(self, time: float) -> float:
        """Microsteps from the begin after `time` seconds."""
        return (self.velocity + 0.5 * self.acceleration * time) * time

    def time_for(self, distance: float) -> float:
        """When `distance` (with the segment's sign) is travelled; the segment must not turn before."""
        # The form without cancellation: t = 2s / (v + sqrt(v2 + 2as)).
        root = math.sqrt(max(self.velocity**2 + 2.0 * self.acceleration * distance, 0.0))
        divisor = abs(self.velocity) + root
        return min(2.0 * abs(distance) / divisor, self.duration) if divisor else self.duration


class Trajectory:
    """Position and velocity over time, monotone: it never turns.

    It begins at `start` (seconds, the caller's clock), runs through its segments and ends at `end` exactly,
    where it rests, or cruises on with `final_velocity` for ever. The velocity may jump between segments
    (VSTART, VSTOP).
    """

    __slots__ = (
        "_positions",
        "_segments",
        "_times",
        "direction",
        "end",
        "final_velocity",
        "finish",
        "origin",
        "start",
    )

    def __init__(
        self,
        start: float,
        origin: float,
        segments: Sequence[Segment] = (),
        *,
        end: float,
        final_velocity: float = 0.0,
    ) -> None:
        self.start = start
        self.origin = origin
        self.end = end
        self.final_velocity = final_velocity
        self._segments = tuple(segments)
        times = [0.0]
        positions = [origin]
        for segment in self._segments:
            times.append(times[-1] + segment.duration)
            positions.append(positions[-1] + segment.travelled(segment.duration))
        self._times = times
        self._positions = positions
        self.finish = start + times[-1]
        reach = (end - origin) or final_velocity
        self.direction = (reach > 0) - (reach < 0)
        """+1, -1, or 0 where nothing moves."""

    @property
    def duration(self) -> float:
        """Seconds from `start` to the end of the ramp."""
        return self._times[-1]

    @property
    def peak_speed(self) -> float:
        """The highest speed on the way, microsteps/s."""
        ends = (abs(s.velocity + s.acceleration * s.duration) for s in self._segments)
        return max((*(abs(s.velocity) for s in self._segments), *ends, abs(self.final_velocity)))

    @property
    def rests(self) -> bool:
        """Whether the end is a standstill."""
        return self.final_velocity == 0.0

    def position(self, time: float) -> float:
        """Position at a time, microsteps; never beyond `end` before `finish`."""
        if time >= self.finish:
            return self.end + self.final_velocity * (time - self.finish) if self.final_velocity else self.end
        elapsed = time - self.start
        if elapsed <= 0:
            return self.origin
        at = self._index(elapsed)
        position = self._positions[at] + self._segments[at].travelled(elapsed - self._times[at])
        return self._within(position)

    def velocity(self, time: float) -> float:
        """Velocity at a time, microsteps/s; after a jump, the new one."""
        if time >= self.finish:
            return self.final_velocity
        elapsed = time - self.start
        if elapsed < 0:
            return 0.0
        at = self._index(elapsed)
        segment = self._segments[at]
        return segment.velocity + segment.acceleration * (elapsed - self._times[at])

    def time_at(self, position: float) -> float | None:
        """When `position` is passed or reached; `start` if it lies behind; None if never."""
        if not self.direction or (position - self.origin) * self.direction <= 0:
            return self.start if self.direction else None
        for at, segment in enumerate(self._segments):
            if (self._positions[at + 1] - position) * self.direction >= 0:
                return self.start + self._times[at] + segment.time_for(position - self._positions[at])
        beyond = (position - self.end) * self.direction
        if beyond <= 0:
            return self.finish
        return self.finish + beyond / abs(self.final_velocity) if self.final_velocity else None

    def time_in_speeds(self, above: float, up_to: float, since: float) -> float | None:
        """The first time from `since` on when the speed is in (above, up_to]; None if never.

        Where a ramp enters the range from below, the time given is the limit, at which it is `above` still.
        """
        for at, segment in enumerate(self._segments):
            begin = max(since - self.start - self._times[at], 0.0)
            if begin >= segment.duration:
                continue
            found = _time_in_range(segment, begin, above, up_to)
            if found is not None:
                return self.start + self._times[at] + found
        if above < abs(self.final_velocity) <= up_to:
            return max(self.finish, since)
        return None

    def _index(self, elapsed: float) -> int:
        return min(bisect_right(self._times, elapsed) - 1, len(self._segments) - 1)

    def _within(self, position: float) -> float:
        if self.direction > 0:
            return min(max(position, self.origin), self.end)
        return max(min(position, self.origin), self.end)


def _time_in_range(segment: Segment, begin: float, above: float, up_to: float) -> float | None:
    speed = abs(segment.velocity + segment.acceleration * begin)
    last = abs(segment.velocity + segment.acceleration * segment.duration)
    if above < speed <= up_to:
        return begin
    rate = abs(segment.acceleration)
    if speed <= above < last and above < up_to:
        return begin + (above - speed) / rate
    if speed > up_to >= last and up_to > above:
        return begin + (speed - up_to) / rate
    return None


def rest(time: float, position: float) -> Trajectory:
    """Standstill at a position."""
    return Trajectory(time, position, end=position)
