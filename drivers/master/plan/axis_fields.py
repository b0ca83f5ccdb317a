"""THE table of an axis's settings, one row each: what it means, its default, its unit, its object, its range.

The order is that in which the objects are written. A setting that is None is left as the module holds it.

Positions are microsteps ("steps"), velocities steps/s, accelerations steps/s2: the module's pps and pps/s
while 208Ch is 181 (manual §4.2.19). What they must keep to with each other is in `axis_rules`, what an object
takes in the profile of the module. Under the same names they are in `app.configuration.axes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from drivers.cia402 import objects
from drivers.master.plan.gearing import Gearing
from drivers.master.plan.setting import Dimension, setting, settings_of

INT32_MIN: Final = -(2**31)
INT32_MAX: Final = 2**31 - 1
HIGHEST_RATE: Final = 16_777_215
"""The highest velocity or acceleration that the ramp generator's registers take (ranges in manual §4.2.11
ff.).
"""
START_VELOCITY: Final = 0x2010
RAMP_V1, RAMP_V2 = 0x2012, 0x2017


def _sensor(from_encoder: bool) -> int:
    """606Ah (manual §5.1.8)."""
    return 0 if from_encoder else -1


@dataclass(frozen=True, slots=True)
class AxisFields:
    """As a person gives them: nothing is checked yet."""

    name: str
    """Unique on its node; not a bare number."""
    unit: str = "steps"
    """The user's unit of length or angle, e.g. ``mm``."""
    steps_per_unit: float | Fraction = Fraction(1)
    """Steps in one `unit`, taken exactly as written; negative turns the direction around. With `gearing` it
    follows from that.
    """
    gearing: Gearing | None = None
    """Motor, gear and pitch; 2000h and 2001h are written to match. None: `steps_per_unit` says it all, and
    the module keeps its resolution.
    """
    switch_parameters: int = setting(0, at=0x2005)
    """2005h, bits of manual table 62: 0 uses both limit switches, 3 ignores them (none wired)."""
    encoder: bool | None = setting(None, at=objects.SENSOR_SELECTION, written=_sensor, still=True)
    """606Ah: whether positions come from the encoder."""
    encoder_resolution: int | None = setting(None, at=(objects.ENCODER_RESOLUTION, 1), still=True)
    """608Fh:1, increments in a motor turn."""
    encoder_null_polarity: int | None = setting(None, at=(0x200B, 1))
    """200Bh:1, 0 or 1."""
    encoder_direction: int | None = setting(None, at=(0x200B, 2))
    """200Bh:2, 1: opposite to the motor."""
    encoder_initialize: int | None = setting(None, at=(0x200B, 3))
    """200Bh:3, 1: positions begin with the encoder's."""
    brake_apply_current: int | None = setting(None, Dimension.CURRENT, at=(0x200C, 1))
    """200Ch:1, 0..255."""
    brake_release_current: int | None = setting(None, Dimension.CURRENT, at=(0x200C, 2))
    """200Ch:2, 0..255; 0 in both: no brake."""
    brake_apply_delay: int | None = setting(None, Dimension.TIME, at=(0x2002, 1))
    """2002h:1, ms from applying the brake to power off."""
    brake_release_delay: int | None = setting(None, Dimension.TIME, at=(0x2002, 2))
    """2002h:2, ms from releasing the brake to OPERATION_ENABLED."""
    enable_delay: int | None = setting(None, Dimension.TIME, at=0x200A)
    """200Ah, ms from power on to releasing the brake."""
    run_current: int | None = setting(None, Dimension.CURRENT, at=0x2003)
    """2003h, 0..255 for 0..100 % of the driver's current."""
    standby_current: int | None = setting(None, Dimension.CURRENT, at=0x2004)
    """2004h, 0..255 for 0..100 % of the driver's current."""
    standby_delay: int | None = setting(None, Dimension.TIME, at=0x2089, tick_us=10_000)
    """2089h, 10 ms each: standstill before the standby current."""
    position_window: int = setting(0, Dimension.POSITION, at=objects.POSITION_WINDOW)
    """6067h, steps: how near the encoder must be to the target; 0: the demand has reached it."""
    position_window_time: int = setting(0, Dimension.TIME, at=objects.POSITION_WINDOW_TIME)
    """6068h, ms in the window before the target counts as reached."""
    following_error_window: int | None = setting(None, Dimension.POSITION, at=objects.FOLLOWING_ERROR_WINDOW)
    """6065h, steps; 0: never."""
    start_velocity: int = setting(0, Dimension.VELOCITY, at=START_VELOCITY, lowest=0, maximum="max_velocity")
    """2010h VSTART, steps/s."""
    end_velocity: int = setting(10, Dimension.VELOCITY, at=objects.END_VELOCITY, maximum="max_velocity")
    """6082h VSTOP, steps/s, at least 10 and at least `start_velocity` (manual §1.5)."""
    ramp_a1: int = setting(0, Dimension.ACCELERATION, at=0x2011, lowest=0, maximum="max_acceleration")
    """2011h, steps/s2: acceleration up to `ramp_v1`."""
    ramp_v1: int = setting(0, Dimension.VELOCITY, at=RAMP_V1, lowest=0)
    """2012h, steps/s: with `ramp_v2` 0 as well the ramp is a trapezoid (manual §1.5)."""
    ramp_d1: int | None = setting(
        None, Dimension.ACCELERATION, at=0x2013, maximum="max_acceleration", counts="d1"
    )
    """2013h, steps/s2: deceleration below `ramp_v1`; never 0. None: `deceleration`."""
    ramp_a2: int = setting(0, Dimension.ACCELERATION, at=0x2016, lowest=0, maximum="max_acceleration")
    """2016h, steps/s2: acceleration from `ramp_v1` to `ramp_v2`."""
    ramp_v2: int = setting(0, Dimension.VELOCITY, at=RAMP_V2, lowest=0)
    """2017h, steps/s."""
    ramp_d2: int | None = setting(
        None, Dimension.ACCELERATION, at=0x2018, maximum="max_acceleration", counts="d2"
    )
    """2018h, steps/s2: deceleration from `ramp_v2` to `ramp_v1`; never 0. None: `deceleration`."""
    ramp_wait: int | None = setting(None, Dimension.TIME, at=0x2015, tick_us=32)
    """2015h, 32 us each: rest at standstill before the next ramp."""
    velocity: int = setting(
        51_200, Dimension.VELOCITY, at=objects.PROFILE_VELOCITY, lowest=1, maximum="max_velocity"
    )
    """6081h, steps/s, 1..16777215: one turn a second of a 200-step motor at 256 microsteps."""
    acceleration: int = setting(
        102_400, Dimension.ACCELERATION, at=objects.PROFILE_ACCELERATION, lowest=1, maximum="max_acceleration"
    )
    """6083h, steps/s2, 1..16777215. Also decelerates in profile velocity (manual §6.1.14)."""
    deceleration: int = setting(
        102_400, Dimension.ACCELERATION, at=objects.PROFILE_DECELERATION, lowest=1, maximum="max_acceleration"
    )
    """6084h, steps/s2, 1..16777215."""
    quick_stop_deceleration: int = setting(
        512_000, Dimension.ACCELERATION, at=objects.QUICK_STOP_DECELERATION, lowest=1
    )
    """6085h, steps/s2, 1..16777215: quick stop and fault reaction."""
    max_velocity: int = setting(HIGHEST_RATE, Dimension.VELOCITY, lowest=1)
    """steps/s: a command above it is refused."""
    max_acceleration: int = setting(HIGHEST_RATE, Dimension.ACCELERATION, lowest=1)
    """steps/s2: a command whose acceleration or deceleration is above it is refused; a quick stop is not."""
    homing_method: int = setting(35, at=objects.HOMING_METHOD)
    """6098h, used when a home command names none. 35 takes the present position as zero and doesn't move."""
    homing_fast: int = setting(
        25_600, Dimension.VELOCITY, at=(objects.HOMING_SPEEDS, 1), lowest=1, maximum="max_velocity"
    )
    """6099h:1, steps/s."""
    homing_slow: int = setting(
        5_120, Dimension.VELOCITY, at=(objects.HOMING_SPEEDS, 2), lowest=1, maximum="max_velocity"
    )
    """6099h:2, steps/s."""
    homing_acceleration: int = setting(
        102_400, Dimension.ACCELERATION, at=objects.HOMING_ACCELERATION, lowest=1, maximum="max_acceleration"
    )
    """609Ah, steps/s2."""
    home_offset: int = setting(0, Dimension.POSITION, at=objects.HOME_OFFSET, signed=True)
    """607Ch, steps."""
    soft_limits: tuple[int, int] | None = None
    """607Dh: lowest and highest target, steps relative to machine home; None: the whole range."""
    position_tolerance: int = setting(0, Dimension.POSITION)
    """How far from the target, in steps, a finished move may read; above 0 only with an encoder."""
    require_homing: bool = setting(False)
    """Whether absolute moves are refused until the axis was homed."""

    @property
    def d1(self) -> int:
        """2013h, steps/s2."""
        return self.deceleration if self.ramp_d1 is None else self.ramp_d1

    @property
    def d2(self) -> int:
        """2018h, steps/s2."""
        return self.deceleration if self.ramp_d2 is None else self.ramp_d2


SETTINGS: Final = settings_of(AxisFields)
"""The rows by name. Gearing and travel limits come to several objects: see `axis_parameters`."""
