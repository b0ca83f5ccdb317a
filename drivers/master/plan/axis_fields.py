"""The settings of one axis, field by field: what each means, its unit, and its default.

Positions are microsteps ("steps"), velocities steps/s, accelerations steps/s2: the module's pps and pps/s
while 208Ch is 181 (manual §4.2.19). What they must keep to is in `axis_rules`.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from drivers.master.plan.gearing import Gearing

INT32_MIN: Final = -(2**31)
INT32_MAX: Final = 2**31 - 1
HIGHEST_RATE: Final = 16_777_215
"""The highest velocity or acceleration that the ramp generator's registers take (ranges in manual §4.2.11
ff.).
"""


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
    velocity: int = 51_200
    """6081h, steps/s, 1..16777215: one turn a second of a 200-step motor at 256 microsteps."""
    acceleration: int = 102_400
    """6083h, steps/s2, 1..16777215. Also decelerates in profile velocity (manual §6.1.14)."""
    deceleration: int = 102_400
    """6084h, steps/s2, 1..16777215."""
    max_velocity: int = HIGHEST_RATE
    """steps/s: a command above it is refused."""
    max_acceleration: int = HIGHEST_RATE
    """steps/s2: a command whose acceleration or deceleration is above it is refused; a quick stop is not."""
    quick_stop_deceleration: int = 512_000
    """6085h, steps/s2, 1..16777215: quick stop and fault reaction."""
    start_velocity: int = 0
    """2010h VSTART, steps/s."""
    end_velocity: int = 10
    """6082h VSTOP, steps/s, at least 10 and at least `start_velocity` (manual §1.5)."""
    ramp_a1: int = 0
    """2011h, steps/s2: acceleration up to `ramp_v1`."""
    ramp_v1: int = 0
    """2012h, steps/s: with `ramp_v2` 0 as well the ramp is a trapezoid (manual §1.5)."""
    ramp_d1: int | None = None
    """2013h, steps/s2: deceleration below `ramp_v1`; never 0. None: `deceleration`."""
    ramp_a2: int = 0
    """2016h, steps/s2: acceleration from `ramp_v1` to `ramp_v2`."""
    ramp_v2: int = 0
    """2017h, steps/s."""
    ramp_d2: int | None = None
    """2018h, steps/s2: deceleration from `ramp_v2` to `ramp_v1`; never 0. None: `deceleration`."""
    ramp_wait: int | None = None
    """2015h, 32 us each: rest at standstill before the next ramp. None: as the module holds it, like every
    None below.
    """
    homing_method: int = 35
    """6098h, used when a home command names none. 35 takes the present position as zero and doesn't move."""
    homing_fast: int = 25_600
    """6099h:1, steps/s."""
    homing_slow: int = 5_120
    """6099h:2, steps/s."""
    homing_acceleration: int = 102_400
    """609Ah, steps/s2."""
    home_offset: int = 0
    """607Ch, steps."""
    soft_limits: tuple[int, int] | None = None
    """607Dh: lowest and highest target, steps relative to machine home; None: the whole range."""
    switch_parameters: int = 0
    """2005h, bits of manual table 62: 0 uses both limit switches, 3 ignores them (none wired)."""
    position_tolerance: int = 0
    """How far from the target, in steps, a finished move may read; above 0 only with an encoder."""
    position_window: int = 0
    """6067h, steps: how near the encoder must be to the target; 0: the demand has reached it."""
    position_window_time: int = 0
    """6068h, ms in the window before the target counts as reached."""
    following_error_window: int | None = None
    """6065h, steps; 0: never."""
    run_current: int | None = None
    """2003h, 0..255 for 0..100 % of the driver's current."""
    standby_current: int | None = None
    """2004h, 0..255 for 0..100 % of the driver's current."""
    standby_delay: int | None = None
    """2089h, 10 ms each: standstill before the standby current."""
    encoder: bool | None = None
    """606Ah: whether positions come from the encoder."""
    encoder_resolution: int | None = None
    """608Fh:1, increments in a motor turn."""
    encoder_null_polarity: int | None = None
    """200Bh:1, 0 or 1."""
    encoder_direction: int | None = None
    """200Bh:2, 1: opposite to the motor."""
    encoder_initialize: int | None = None
    """200Bh:3, 1: positions begin with the encoder's."""
    brake_apply_current: int | None = None
    """200Ch:1, 0..255."""
    brake_release_current: int | None = None
    """200Ch:2, 0..255; 0 in both: no brake."""
    brake_apply_delay: int | None = None
    """2002h:1, ms from applying the brake to power off."""
    brake_release_delay: int | None = None
    """2002h:2, ms from releasing the brake to OPERATION_ENABLED."""
    enable_delay: int | None = None
    """200Ah, ms from power on to releasing the brake."""
    require_homing: bool = False
    """Whether absolute moves are refused until the axis was homed."""

    @property
    def d1(self) -> int:
        """2013h, steps/s2."""
        return self.deceleration if self.ramp_d1 is None else self.ramp_d1

    @property
    def d2(self) -> int:
        """2018h, steps/s2."""
        return self.deceleration if self.ramp_d2 is None else self.ramp_d2
