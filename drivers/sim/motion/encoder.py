"""The position actual value: the motor's counter, or an encoder on the carriage."""

from __future__ import annotations

from drivers.cia402 import objects
from drivers.sim.interface import AxisParameters
from drivers.sim.motion.motor import Motor
from drivers.sim.motion.travel import AxisSettings

ENCODER_PARAMETERS = 0x200B
FULL_STEPS = 0x2001
MICROSTEP_RESOLUTION = 0x2000


class Encoder:
    """An incremental encoder: it counts from where it was zeroed, in its own increments.

    Supervision (following error, windows, limits) reads it unquantised; 6064h shows whole increments,
    rescaled to microsteps (manual §6.1.4). The count can be set anew at any place, as homing does.
    """

    def __init__(self, parameters: AxisParameters, settings: AxisSettings, motor: Motor) -> None:
        self._parameters = parameters
        self._settings = settings
        self._motor = motor
        self._zero_place = settings.start
        self._zero_value = 0

    @property
    def used(self) -> bool:
        """606Ah = 0."""
        return self._parameters.get(objects.SENSOR_SELECTION) == 0

    @property
    def line(self) -> tuple[float, float]:
        """(slope, offset) of the actual position over the counter, for as long as nothing happens."""
        if not self.used:
            return 1.0, 0.0
        stuck = self._motor.stuck
        sign = self._sign
        if stuck is not None:
            return 0.0, self._zero_value + sign * (stuck - self._zero_place)
        return float(sign), self._zero_value + sign * (self._motor.offset - self._zero_place)

    def exact(self, now: float) -> float:
        """The actual position, unquantised."""
        slope, offset = self.line
        return slope * self._motor.position(now) + offset

    def shown(self, now: float) -> int:
        """6064h."""
        if not self.used:
            return round(self._motor.position(now))
        turn, increments = self._microsteps_a_turn, self._increments_a_turn
        count = round((self._motor.place(now) - self._zero_place) * increments / turn)
        return self._zero_value + self._sign * round(count * turn / increments)

    def set(self, value: int, now: float) -> None:
        """Count from here on from `value`."""
        self._zero_place = round(self._motor.place(now))
        self._zero_value = value

    def disagrees(self, now: float) -> bool:
        """Whether an encoder is used and is more than an increment away from the motor's counter."""
        increment = self._microsteps_a_turn / self._increments_a_turn
        return self.used and abs(self.shown(now) - self._motor.position(now)) > increment

    @property
    def initialises_counter(self) -> bool:
        """200Bh:3: the motor's counter takes the encoder's position over (manual §4.2.8)."""
        return self._parameters.get(ENCODER_PARAMETERS, 3) == 1

    @property
    def _sign(self) -> int:
        reversed_by_parameter = self._parameters.get(ENCODER_PARAMETERS, 2) == 1
        return 1 if reversed_by_parameter == self._settings.encoder_reversed else -1

    @property
    def _increments_a_turn(self) -> int:
        return max(self._parameters.get(objects.ENCODER_RESOLUTION, 1), 1)

    @property
    def _microsteps_a_turn(self) -> int:
        return max(self._parameters.get(FULL_STEPS), 1) << self._parameters.get(MICROSTEP_RESOLUTION)
