"""Profile position mode: set points, the EightPoint ramp, the position window (manual §6)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from drivers.cia402 import objects
from drivers.cia402.power import Controlword, Statusword
from drivers.devices.ramp import Ramp, bands
from drivers.sim.motion.context import Context, around
from drivers.sim.motion.goals import MoveTo, Stop
from drivers.sim.motion.mode import ModeControl

A1, V1, D1, A2, V2, D2 = 0x2011, 0x2012, 0x2013, 0x2016, 0x2017, 0x2018
WINDOW_OFF: Final = 0xFFFF_FFFF
PROCESSING: Final = 0.001
"""Seconds for which bit 12 says at least that a set point is in process (unverified on hardware)."""


class ProfilePosition(ModeControl):
    """One set point at a time.

    Unverified on hardware: a new set point during a move replaces the old one at once, on the fly; a set
    point whose ramp has a zero among its parameters doesn't run and stays in process; parameters count as
    they are when the set point is taken; with the position window off (6067h = FFFFFFFFh) bit 10 behaves as
    with a window of 0; after enabling, "the preceding target" of 60F2h is the position where the motor
    stands.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._target = 0
        self._limited = False
        self._in_process = False
        self._seen_until = 0.0
        self._within_since: float | None = None
        self._within = False

    def slow_down(self) -> Stop:
        """With 6084h down to VSTOP."""
        context = self.context
        return Stop(
            context.acceleration(objects.PROFILE_DECELERATION), context.stop_speed, wait=context.ramp_wait
        )

    def begin(self, now: float) -> None:
        """Stand on the spot as if it were the target."""
        self._target = round(self.context.motor.position(now))
        self._limited = False
        self.observe(now)

    def end(self, now: float) -> None:
        """The set point is dropped."""
        del now
        self._in_process = False
        self._within_since = None
        self._within = False

    def control(self, previous: int, word: int, now: float) -> None:
        """Bit 4 rising takes a set point; halt interrupts it, and its end resumes it (CiA 402)."""
        if not self.context.drive.active:
            return
        rising, falling = word & ~previous, previous & ~word
        if rising & Controlword.NEW_SET_POINT:
            self._take(bool(word & Controlword.RELATIVE), now)
        if rising & Controlword.HALT:
            self.context.motor.pursue(self.slow_down(), now)
            return
        resumed = rising & Controlword.NEW_SET_POINT or falling & Controlword.HALT
        if resumed and self._in_process and not self.context.halted:
            self.context.motor.pursue(self._move(), now)

    def observe(self, now: float) -> None:
        """The end of the set point, and the position window with its dwell time."""
        if self._in_process and self._arrived() and now >= self._seen_until:
            self._in_process = False
        self._observe_window(now)

    def deadline(self) -> float | None:
        """The end of the set point's processing, or of the dwell time."""
        if self._in_process and self._arrived():
            return self._seen_until
        if self._within_since is not None and not self._within:
            return self._within_since + self._dwell
        return None

    def marks(self) -> Iterable[float]:
        """The edges of the position window."""
        window = self._window
        return self.context.actual_marks(around(self._target, window)) if window else ()

    def bits(self, now: float) -> int:
        """Target reached, set point in process, limited target."""
        bits = Statusword.BIT12 if self._in_process else 0
        if self._limited:
            bits |= Statusword.INTERNAL_LIMIT
        if self._reached(now):
            bits |= Statusword.TARGET_REACHED
        return bits

    def _take(self, relative: bool, now: float) -> None:
        wanted = self.context.parameters.get(objects.TARGET_POSITION)
        if relative:
            wanted += self._base(now)
        self._target = self.context.limited(max(min(wanted, 2**31 - 1), -(2**31)))
        self._limited = self._target != wanted
        self._in_process = True
        self._seen_until = now + PROCESSING
        self._within = False
        self._within_since = None

    def _base(self, now: float) -> int:
        option = self.context.parameters.get(objects.POSITIONING_OPTION) & 3
        if option == 1:
            return round(self.context.motor.position(now))
        if option == 2:
            return self.context.encoder.shown(now)
        return self._target

    def _move(self) -> MoveTo:
        context = self.context
        v1, v2 = context.velocity(V1), context.velocity(V2)
        maximum = context.acceleration(objects.PROFILE_ACCELERATION)
        minimum = context.acceleration(objects.PROFILE_DECELERATION)
        shape = Ramp(
            context.start_speed,
            context.stop_speed,
            context.velocity(objects.PROFILE_VELOCITY),
            bands(v1, v2, context.acceleration(A1), context.acceleration(A2), maximum),
            bands(v1, v2, context.acceleration(D1), context.acceleration(D2), minimum),
        )
        return MoveTo(self._target, shape, context.ramp_wait)

    def _arrived(self) -> bool:
        motor = self.context.motor
        goal = motor.goal
        return isinstance(goal, MoveTo) and goal.shape.complete and motor.arrived

    def _reached(self, now: float) -> bool:
        if self.context.halted and self.context.drive.active:
            return self.context.motor.standing
        if self._window:
            return self._within
        return not self._in_process and self.context.motor.position(now) == self._target

    @property
    def _window(self) -> int:
        """0 where the demand position alone counts."""
        window = self.context.parameters.get(objects.POSITION_WINDOW)
        return 0 if window == WINDOW_OFF else window

    @property
    def _dwell(self) -> float:
        return self.context.parameters.get(objects.POSITION_WINDOW_TIME) / 1000.0

    def _observe_window(self, now: float) -> None:
        window = self._window
        low, high = around(self._target, window)
        if not window or not low < self.context.encoder.exact(now) < high:
            self._within_since = None
            self._within = False
            return
        if self._within_since is None:
            self._within_since = now
        self._within = now >= self._within_since + self._dwell
