"""What a motor is told to do, and how one leg of it is planned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.devices import ramp
from drivers.devices.trajectory import Trajectory, rest


class Goal(Protocol):
    """An aim that the motor pursues in one or more legs, with a rest in between."""

    @property
    def wait(self) -> float:
        """Seconds to rest before a leg that begins at standstill (2015h)."""
        ...

    def plan(self, start: float, origin: float, velocity: float) -> Trajectory:
        """The next leg from a position and a velocity."""
        ...

    def reached_by(self, leg: Trajectory) -> bool:
        """Whether the end of `leg` is the aim, so that no other leg follows."""
        ...


@dataclass(frozen=True, slots=True)
class MoveTo:
    """Come to rest on a target (pp)."""

    target: int
    shape: ramp.Ramp
    wait: float = 0.0

    def plan(self, start: float, origin: float, velocity: float) -> Trajectory:
        """A leg towards the target; with a zero among the ramp's parameters, a stop."""
        if self.shape.complete:
            return ramp.plan_move(start, origin, velocity, self.target, self.shape)
        return Stop(0.0).plan(start, origin, velocity)

    def reached_by(self, leg: Trajectory) -> bool:
        """At rest on the target; a move that can't run never ends, and never goes on."""
        return leg.end == self.target or not self.shape.complete


@dataclass(frozen=True, slots=True)
class RunAt:
    """Run at a velocity until told otherwise (pv, csv, homing)."""

    velocity: float
    rate: float
    start_speed: float = 0.0
    stop_speed: float = 0.0
    wait: float = 0.0

    def plan(self, start: float, origin: float, velocity: float) -> Trajectory:
        """A leg towards the velocity. With a rate of 0 nothing changes, except that a stop is at once."""
        if not self.rate:
            if not self.velocity:
                return Stop(0.0).plan(start, origin, velocity)
            return Trajectory(start, origin, end=origin, final_velocity=velocity)
        return ramp.plan_velocity(
            start, origin, velocity, self.velocity, self.rate, self.start_speed, self.stop_speed
        )

    def reached_by(self, leg: Trajectory) -> bool:
        """The leg ends at the velocity."""
        return leg.final_velocity == self.velocity or not self.rate


@dataclass(frozen=True, slots=True)
class Stop:
    """Ramp down to standstill. A rate of 0 stops at once."""

    rate: float
    stop_speed: float = 0.0
    wait: float = 0.0

    def plan(self, start: float, origin: float, velocity: float) -> Trajectory:
        """The ramp down."""
        if not velocity:
            return rest(start, ramp.whole_step(origin, velocity))
        return ramp.plan_stop(start, origin, velocity, self.rate, self.stop_speed)

    def reached_by(self, leg: Trajectory) -> bool:
        """Always."""
        return leg.rests


@dataclass(frozen=True, slots=True)
class Follow:
    """Be at a target after a period, without a ramp (csp)."""

    target: int
    period: float
    wait: float = 0.0

    def plan(self, start: float, origin: float, velocity: float) -> Trajectory:
        """One straight leg."""
        del velocity
        return ramp.plan_follow(start, origin, self.target, self.period)

    def reached_by(self, leg: Trajectory) -> bool:
        """Always."""
        return leg.end == self.target
