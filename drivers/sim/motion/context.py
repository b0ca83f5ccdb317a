"""What the modes of operation share: parameters in microsteps and seconds, motor, encoder and drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from drivers.cia402 import objects
from drivers.cia402.power import Controlword
from drivers.sim.interface import AxisParameters
from drivers.sim.motion.drive import Drive
from drivers.sim.motion.encoder import Encoder
from drivers.sim.motion.motor import Motor
from drivers.sim.motion.travel import HALF, Levels, SwitchParameters, Travel

SWITCH_PARAMETERS: Final = 0x2005
START_VELOCITY: Final = 0x2010
RAMP_WAIT: Final = 0x2015
VELOCITY_DIMENSION: Final = 0x208C

_PPS: Final = 181
_CLOCK: Final = 16e6
_INTERNAL_VELOCITY: Final = _CLOCK / 2**24
_INTERNAL_ACCELERATION: Final = _CLOCK**2 / (512 * 256) / 2**24
_NO_LIMITS: Final = (-(2**31), 2**31 - 1)


@dataclass(frozen=True, slots=True)
class Context:
    """One axis, as its modes see it."""

    parameters: AxisParameters
    travel: Travel
    motor: Motor
    encoder: Encoder
    drive: Drive

    @property
    def following(self) -> bool:
        """Whether set points are followed and halt is not set."""
        return self.drive.active and not self.halted

    @property
    def halted(self) -> bool:
        """Controlword bit 8."""
        return bool(self.drive.word & Controlword.HALT)

    def velocity(self, index: int, sub: int = 0) -> float:
        """A velocity object in microsteps/s, whatever 208Ch makes its unit."""
        return self.parameters.get(index, sub) * self.velocity_unit

    def acceleration(self, index: int) -> float:
        """An acceleration object in microsteps/s2."""
        internal = self.parameters.get(VELOCITY_DIMENSION) != _PPS
        return self.parameters.get(index) * (_INTERNAL_ACCELERATION if internal else 1.0)

    @property
    def velocity_unit(self) -> float:
        """Microsteps/s of 1 in a velocity object; for internal units (208Ch = 0) unverified on hardware."""
        return 1.0 if self.parameters.get(VELOCITY_DIMENSION) == _PPS else _INTERNAL_VELOCITY

    @property
    def ramp_wait(self) -> float:
        """2015h in seconds."""
        return self.parameters.get(RAMP_WAIT) * 32e-6

    @property
    def start_speed(self) -> float:
        """VSTART."""
        return self.velocity(START_VELOCITY)

    @property
    def stop_speed(self) -> float:
        """VSTOP."""
        return self.velocity(objects.END_VELOCITY)

    @property
    def software_limits(self) -> tuple[int, int] | None:
        """607Dh corrected by 607Ch (manual §6.1.11); None where they span everything.

        Limits that contradict each other count as none: unverified on hardware.
        """
        low = self.parameters.get(objects.SOFTWARE_LIMIT, 1)
        high = self.parameters.get(objects.SOFTWARE_LIMIT, 2)
        if (low, high) == _NO_LIMITS or low > high:
            return None
        offset = self.parameters.get(objects.HOME_OFFSET)
        return low - offset, high - offset

    def limited(self, target: int) -> int:
        """A target cut down to the software limits, where it is beyond them (unverified on hardware)."""
        limits = self.software_limits
        return target if limits is None else min(max(target, limits[0]), limits[1])

    def levels(self, now: float) -> Levels:
        """The switches that the drive acts on (2005h applied)."""
        bits = SwitchParameters(self.parameters.get(SWITCH_PARAMETERS))
        return bits.effective(self.travel.levels(self.motor.place(now), bits))

    def actual_marks(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """The counter values at which the actual position takes some values."""
        slope, offset = self.encoder.line
        return tuple((value - offset) / slope for value in values) if slope else ()

    def set_position(self, value: int, now: float) -> None:
        """Give the place where the motor rests a new position, in counter and encoder."""
        self.motor.relocate(value, now)
        self.encoder.set(value, now)


def around(value: float, window: float) -> tuple[float, float]:
    """The edges of a window, half a microstep outside, so that its last microstep is within."""
    return value - window - HALF, value + window + HALF
