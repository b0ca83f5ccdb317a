"""A stepper motor with its position counter, and the carriage that follows it as long as nothing holds it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from drivers.devices.trajectory import Trajectory, rest
from drivers.sim.motion.goals import Goal, Stop
from drivers.sim.motion.travel import HALF, Travel

BEYOND: Final = 2.0**-10
"""How far, in microsteps, the counter counts as past a mark at the instant when it passes it."""


class Mark(NamedTuple):
    """A counter value that is worth waking up for, and when it is passed."""

    time: float
    position: float


class Motor:
    """Pursues one goal at a time. The counter is what 6062h shows; the carriage's `place` is on the travel's
    scale.

    Time is an argument everywhere and never goes back. Between two events (`leg_end`, a mark passed) nothing
    here changes: a position at any time comes from the trajectory alone.
    """

    def __init__(self, travel: Travel) -> None:
        self._travel = travel
        self._leg: Trajectory = rest(0.0, 0.0)
        self._goal: Goal = Stop(0.0)
        self._ended = True
        self._stopped_at = float("-inf")
        self._seen: float | None = None
        self._offset = travel.settings.start
        self._held: int | None = None
        self._pinned: tuple[int, int] | None = None
        self.last_direction = 1
        """Of the last leg: +1 or -1."""

    # --- where it is ----------------------------------------------------------------------------------------

    def position(self, now: float) -> float:
        """The counter, microsteps; whole when at rest."""
        position = self._leg.position(now)
        if self._seen is None:
            return position
        return max(position, self._seen) if self._leg.direction > 0 else min(position, self._seen)

    def velocity(self, now: float) -> float:
        """Of the counter, microsteps/s."""
        return self._leg.velocity(now)

    def place(self, now: float) -> float:
        """Where the carriage is on the travel."""
        stuck = self.stuck
        return self.position(now) + self._offset if stuck is None else stuck

    @property
    def stuck(self) -> int | None:
        """Where the carriage is held while the motor slips; None while it follows."""
        if self._held is not None:
            return self._held
        return None if self._pinned is None else self._pinned[0]

    @property
    def offset(self) -> int:
        """Place minus counter, while the carriage follows."""
        return self._offset

    @property
    def standing(self) -> bool:
        """Whether the motor is at rest and no leg is under way or waiting."""
        return self._ended and self._leg.rests

    @property
    def arrived(self) -> bool:
        """Whether the goal's last leg has ended."""
        return self._ended and self._goal.reached_by(self._leg)

    @property
    def goal(self) -> Goal:
        """What it was told last."""
        return self._goal

    @property
    def direction(self) -> int:
        """Of the leg under way: +1, -1, or 0 at rest."""
        return 0 if self.standing else self._leg.direction

    def turning(self, now: float) -> bool:
        """Whether the motor rotates (not: waits out the ramp wait time)."""
        return not self.standing and now >= self._leg.start and self._leg.direction != 0

    # --- what it is told ------------------------------------------------------------------------------------

    def pursue(self, goal: Goal, now: float) -> None:
        """Take up a goal on the fly."""
        self._goal = goal
        self._begin_leg(now)

    def cut(self, now: float) -> None:
        """Stand still at once, on the next microstep in the direction of motion."""
        if not self.standing:
            self.pursue(Stop(0.0), now)
            self.end_leg(now)

    def relocate(self, position: int, now: float) -> None:
        """Give the place where the motor rests another counter value."""
        self._offset = round(self.place(now)) - position
        self._leg = rest(now, float(position))
        self._goal = Stop(0.0)
        self._ended = True
        self._seen = None

    def hold(self, now: float) -> None:
        """Something holds the carriage where it is: the motor slips."""
        if self._held is None:
            self._held = round(self.place(now))

    def let_go(self, now: float) -> None:
        """The carriage follows again, with the steps lost."""
        if self._held is not None:
            self._offset = self._held - round(self.position(now))
            self._held = self._pinned = None

    # --- when something happens -----------------------------------------------------------------------------

    @property
    def leg_end(self) -> float | None:
        """When the leg under way ends; call `end_leg` then."""
        return None if self._ended else self._leg.finish

    def end_leg(self, now: float) -> None:
        """The leg's end was reached: rest, cruise, or begin the next leg."""
        self._ended = True
        if self._leg.rests:
            self._stopped_at = self._leg.finish
            self._seen = None
        if not self._goal.reached_by(self._leg):
            self._begin_leg(now)

    def next_mark(self, marks: Iterable[float], now: float) -> Mark | None:
        """The first of some counter values that is passed from `now` on."""
        direction = self.direction
        if not direction:
            return None
        position = self.position(now)
        nearest = min(
            (mark for mark in marks if (mark - position) * direction > 0),
            key=lambda m: m * direction,
            default=None,
        )
        time = None if nearest is None else self._leg.time_at(nearest)
        return None if nearest is None or time is None else Mark(max(time, now), nearest)

    def place_marks(self, places: Iterable[float]) -> Iterable[float]:
        """Counter values for places on the travel; none while the carriage is held."""
        return () if self.stuck is not None else (place - self._offset for place in places)

    def end_stop_mark(self) -> float | None:
        """The counter value at which the carriage hits the hard stop ahead."""
        direction = self.direction
        stop = self._travel.end_stop(direction) if direction and self.stuck is None else None
        return None if stop is None else stop + HALF * direction - self._offset

    def passed(self, mark: float) -> None:
        """The counter went past a mark just now."""
        direction = self._leg.direction
        if mark == self.end_stop_mark():
            place = round(mark - HALF * direction) + self._offset
            self._pinned = (place, direction)
        self._seen = mark + BEYOND * direction

    def time_in_speeds(self, above: float, up_to: float, since: float) -> float | None:
        """The first time from `since` on at which the speed is in (above, up_to]."""
        return None if self.standing else self._leg.time_in_speeds(above, up_to, since)

    def _begin_leg(self, now: float) -> None:
        velocity = self.velocity(now)
        origin = self.position(now)
        start = now if velocity else max(now, self._stopped_at + self._goal.wait)
        self._leg = self._goal.plan(start, origin, velocity)
        self._seen = None
        self._ended = not self._leg.direction
        self.last_direction = self._leg.direction or self.last_direction
        if self._pinned is not None and self._leg.direction == -self._pinned[1]:
            self._offset = self._pinned[0] - round(origin)
            self._pinned = None
        if velocity and self._ended:
            self._stopped_at = now
