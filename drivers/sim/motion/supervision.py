"""What watches a running motor: limit switches, software limits, following error, stall."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from drivers.cia402 import objects
from drivers.sim.motion import load as torque
from drivers.sim.motion.context import Context, around
from drivers.sim.motion.mode import ModeControl
from drivers.sim.motion.travel import HALF, Levels
from drivers.sim.motion.troubles import Trouble

STALLGUARD2_THRESHOLD: Final = 0x209E
STOP_ON_STALL: Final = 0x20A4
STALL_OPTION: Final = 0x20A7
STALLGUARD4_THRESHOLD: Final = 0x20A8
PWM_THRESHOLD_SPEED: Final = 0x20B0


class Supervision:
    """Finds what is wrong, and the counter values and times at which it may become wrong.

    Unverified on hardware: a limit switch that is touched while OPERATION_ENABLED stops the motor at once and
    is a fault, as is a motion that begins towards an active one; leaving it is free. The same goes for the
    software limits, with a ramp. 20A4h = 0 turns stop on stall off.
    """

    def __init__(self, context: Context, load: float) -> None:
        self._context = context
        self._levels = Levels(False, False, False)
        self.load = load
        """Share of the motor's torque that the mechanics take."""

    @property
    def effective_load(self) -> float:
        """The load, which is all the motor has where the carriage is held."""
        return 1.0 if self._context.motor.stuck is not None else self.load

    def settle(self, now: float) -> None:
        """Take the switches as they are, without an edge."""
        self._levels = self._context.levels(now)

    def touched(self, mode: ModeControl, now: float) -> Iterator[Trouble]:
        """Limit switches that became active since the last call and that the mode doesn't deal with."""
        before, self._levels = self._levels, self._context.levels(now)
        if self._levels.positive and not before.positive and not mode.expects_limit(+1):
            yield Trouble.POSITIVE_LIMIT_SWITCH
        if self._levels.negative and not before.negative and not mode.expects_limit(-1):
            yield Trouble.NEGATIVE_LIMIT_SWITCH

    def barred(self, mode: ModeControl, now: float) -> Iterator[Trouble]:
        """Limits towards which, or beyond which, the motor moves."""
        direction = self._context.motor.direction
        if direction > 0 and self._levels.positive and not mode.expects_limit(+1):
            yield Trouble.POSITIVE_LIMIT_SWITCH
        if direction < 0 and self._levels.negative and not mode.expects_limit(-1):
            yield Trouble.NEGATIVE_LIMIT_SWITCH
        limits = None if mode.ignores_software_limits else self._context.software_limits
        if limits is None:
            return
        direction *= round(self._context.encoder.line[0])
        actual = self._context.encoder.exact(now)
        if direction > 0 and actual > limits[1] + HALF:
            yield Trouble.POSITIVE_SOFTWARE_LIMIT
        if direction < 0 and actual < limits[0] - HALF:
            yield Trouble.NEGATIVE_SOFTWARE_LIMIT

    def deviates(self, now: float) -> bool:
        """Whether the encoder is further from the counter than 6065h allows."""
        window = self._window
        if not window:
            return False
        return abs(self._context.motor.position(now) - self._context.encoder.exact(now)) > window + HALF

    def marks(self) -> Iterable[float]:
        """Counter values at which one of these may change."""
        context = self._context
        yield from context.motor.place_marks(context.travel.edges())
        limits = context.software_limits
        if limits is not None:
            yield from context.actual_marks((limits[0] - HALF, limits[1] + HALF))
        window = self._window
        slope, offset = context.encoder.line
        if window and slope != 1.0:
            for deviation in around(0.0, window):
                yield (offset + deviation) / (1.0 - slope)

    def stall_time(self, since: float) -> float | None:
        """When the motor stalls from `since` on, by StallGuard4 up to 20B0h and by StallGuard2 above."""
        context = self._context
        if context.motor.standing:
            return None
        lowest = context.velocity(STOP_ON_STALL)
        if not lowest:
            return None
        get = context.parameters.get
        quiet = context.velocity(PWM_THRESHOLD_SPEED)
        ranges = (
            (lowest, min(torque.stall_speed4(self.effective_load, get(STALLGUARD4_THRESHOLD)), quiet)),
            (max(lowest, quiet), torque.stall_speed(self.effective_load, get(STALLGUARD2_THRESHOLD))),
        )
        times = (
            context.motor.time_in_speeds(above, up_to, since) for above, up_to in ranges if above < up_to
        )
        return min((time for time in times if time is not None), default=None)

    @property
    def limited(self) -> bool:
        """Whether a limit switch that counts is active."""
        return self._levels.positive or self._levels.negative

    @property
    def _window(self) -> int:
        context = self._context
        return context.parameters.get(objects.FOLLOWING_ERROR_WINDOW) if context.encoder.used else 0
