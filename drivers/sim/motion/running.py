"""Profile velocity mode, and the cyclic synchronous modes for position and velocity (manual §7, §9, §10)."""

from __future__ import annotations

from drivers.cia402 import objects
from drivers.cia402.power import Controlword, Statusword
from drivers.sim.motion.context import Context
from drivers.sim.motion.goals import Follow, Goal, RunAt, Stop
from drivers.sim.motion.mode import ModeControl


class ProfileVelocity(ModeControl):
    """Runs at 60FFh whenever OPERATION_ENABLED without halt: also at once after enabling, if it is not 0."""

    def slow_down(self) -> Stop:
        """With 6083h, as pv uses it both ways (manual §1.5, §6.1.14), down to VSTOP."""
        context = self.context
        return Stop(
            context.acceleration(objects.PROFILE_ACCELERATION), context.stop_speed, wait=context.ramp_wait
        )

    def begin(self, now: float) -> None:
        """Run."""
        if self.context.following:
            self.context.motor.pursue(self._goal(), now)

    def control(self, previous: int, word: int, now: float) -> None:
        """Halt and its release."""
        if not self.context.drive.active or not (previous ^ word) & Controlword.HALT:
            return
        self.context.motor.pursue(self.slow_down() if word & Controlword.HALT else self._goal(), now)

    def written(self, index: int, now: float) -> None:
        """A new target velocity counts at once. Rates count as they are then."""
        if index == objects.TARGET_VELOCITY and self.context.following:
            self.context.motor.pursue(self._goal(), now)

    def bits(self, now: float) -> int:
        """Target reached: the target speed, or standstill in a halt."""
        if not self.context.drive.active:
            return 0
        motor = self.context.motor
        if self.context.halted:
            return Statusword.TARGET_REACHED if motor.standing else 0
        reached = motor.arrived and motor.velocity(now) == self.context.velocity(objects.TARGET_VELOCITY)
        return Statusword.TARGET_REACHED if reached else 0

    def _goal(self) -> RunAt:
        context = self.context
        return RunAt(
            context.velocity(objects.TARGET_VELOCITY),
            context.acceleration(objects.PROFILE_ACCELERATION),
            context.start_speed,
            context.stop_speed,
            context.ramp_wait,
        )


class _Cyclic(ModeControl):
    """A set point counts when it is written, and with each SYNC; none counts before the first since enabling.

    Whether the module waits for the SYNC is unverified on hardware; with synchronous RPDOs it makes no
    difference.
    """

    objects_taken: tuple[int, ...] = ()

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._fresh = False
        self._taken: int | None = None

    def goal(self, target: int, now: float) -> Goal:
        """What a set point means."""
        raise NotImplementedError

    def target(self) -> int:
        """The set point with its offset."""
        raise NotImplementedError

    @property
    def period(self) -> float:
        """60C2h in seconds; 1 ms where it is 0 (unverified on hardware)."""
        get = self.context.parameters.get
        value = get(objects.INTERPOLATION_PERIOD, 1) * 10.0 ** get(objects.INTERPOLATION_PERIOD, 2)
        return value or 0.001

    def begin(self, now: float) -> None:
        """Go to a set point that was already given."""
        self._follow(now)

    def end(self, now: float) -> None:
        """Old set points count no more."""
        del now
        self._fresh = False
        self._taken = None

    def written(self, index: int, now: float) -> None:
        """Go to the new set point."""
        if index in self.objects_taken:
            self._fresh = True
            self._taken = None
            self._follow(now)

    def sync(self, now: float) -> None:
        """Go to the set point, if it is another one."""
        self._follow(now)

    def control(self, previous: int, word: int, now: float) -> None:
        """Halt ramps down with 6085h; its release takes the set point up again."""
        if not self.context.drive.active or not (previous ^ word) & Controlword.HALT:
            return
        if word & Controlword.HALT:
            self.context.motor.pursue(self.slow_down(), now)
        else:
            self._taken = None
            self._follow(now)

    def bits(self, now: float) -> int:
        """Bit 12: the set point is followed."""
        del now
        return Statusword.BIT12 if self.context.following else 0

    def _follow(self, now: float) -> None:
        target = self.target()
        if self.context.following and self._fresh and target != self._taken:
            self._taken = target
            self.context.motor.pursue(self.goal(target, now), now)


class CyclicPosition(_Cyclic):
    """csp: 607Ah + 60B0h is reached within 60C2h at constant speed."""

    objects_taken = (objects.TARGET_POSITION, objects.POSITION_OFFSET)

    def target(self) -> int:
        """607Ah + 60B0h, within the software limits."""
        get = self.context.parameters.get
        return self.context.limited(get(objects.TARGET_POSITION) + get(objects.POSITION_OFFSET))

    def goal(self, target: int, now: float) -> Follow:
        """A straight leg."""
        del now
        return Follow(target, self.period)

    def bits(self, now: float) -> int:
        """Also: the target is beyond the software limits."""
        get = self.context.parameters.get
        wanted = get(objects.TARGET_POSITION) + get(objects.POSITION_OFFSET)
        limited = self.context.following and self._fresh and wanted != self.target()
        return super().bits(now) | (Statusword.INTERNAL_LIMIT if limited else 0)


class CyclicVelocity(_Cyclic):
    """csv: 60FFh + 60B1h is reached within 60C2h at constant acceleration, and kept."""

    objects_taken = (objects.TARGET_VELOCITY, objects.VELOCITY_OFFSET)

    def target(self) -> int:
        """60FFh + 60B1h in the objects' unit."""
        get = self.context.parameters.get
        return get(objects.TARGET_VELOCITY) + get(objects.VELOCITY_OFFSET)

    def goal(self, target: int, now: float) -> RunAt:
        """A velocity ramp as long as the period."""
        velocity = target * self.context.velocity_unit
        return RunAt(velocity, abs(velocity - self.context.motor.velocity(now)) / self.period)
