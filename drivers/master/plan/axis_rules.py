"""What an axis's settings must keep to: each rule by name, with where it comes from.

Held against every configuration when it is made, so a file and a request meet the same rules. What the
module's own objects take is in `axis_parameters`, since that differs between models.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from drivers.errors import BrokenRule
from drivers.master.plan.axis_fields import HIGHEST_RATE, INT32_MAX, INT32_MIN, SETTINGS, AxisFields
from drivers.master.plan.gearing import Gearing

LOWEST_STOP_VELOCITY: Final = 10
"""Of VSTOP; below it a target might not be reached (manual §1.5)."""
_LARGEST_TERM: Final = 10**15
"""Of a gear's or a pitch's ratio, so that numbers stay handy."""


def broken_rules(config: AxisFields) -> Iterator[BrokenRule]:
    """Every rule that a configuration breaks."""
    if not config.name.strip() or config.name.strip().isdecimal():
        yield BrokenRule("name", "name_is_a_word", "An axis needs a name that is no bare number.")
    yield from _rates(config)
    yield from _stop_and_start(config)
    yield from _eight_points(config)
    yield from _maxima(config)
    yield from _positions(config)


def broken_gearing(gearing: Gearing) -> Iterator[BrokenRule]:
    """Every rule that a gearing breaks."""
    if not 1 <= gearing.full_steps <= 65_535:
        yield BrokenRule("full_steps", "range_2001h", "full_steps must be 1..65535 (2001h, manual §4.2.2).")
    if gearing.microsteps not in {1 << exponent for exponent in range(9)}:
        yield BrokenRule(
            "microsteps",
            "range_2000h",
            "microsteps must be a power of 2 from 1 to 256 (2000h, manual §4.2.1).",
        )
    if gearing.direction not in (1, -1):
        yield BrokenRule("direction", "one_or_minus_one", "direction must be 1 or -1.")
    for name, ratio in (("gear", gearing.gear), ("pitch", gearing.pitch_um)):
        if ratio is not None and not (ratio > 0 and max(ratio.numerator, ratio.denominator) <= _LARGEST_TERM):
            yield BrokenRule(name, "ratio_above_0", f"{name} must be above 0, with at most 15 digits.")


def _rates(config: AxisFields) -> Iterator[BrokenRule]:
    for name, row in SETTINGS.items():
        value: int | None = getattr(config, name)
        if row.lowest is None or value is None or row.lowest <= value <= HIGHEST_RATE:
            continue
        yield BrokenRule(
            name,
            "range_of_rates",
            f"{name} must be {row.lowest}..{HIGHEST_RATE} steps/s or steps/s2, not {value}.",
        )


def _stop_and_start(config: AxisFields) -> Iterator[BrokenRule]:
    if not LOWEST_STOP_VELOCITY <= config.end_velocity <= HIGHEST_RATE:
        yield BrokenRule(
            "end_velocity",
            "vstop_at_least_10",
            f"end_velocity (VSTOP, 6082h) must be {LOWEST_STOP_VELOCITY}..{HIGHEST_RATE} steps/s, "
            f"not {config.end_velocity} (manual §1.5).",
        )
    if config.end_velocity < config.start_velocity:
        yield BrokenRule(
            "end_velocity",
            "vstop_at_least_vstart",
            f"end_velocity (VSTOP, 6082h: {config.end_velocity} steps/s) must be at least start_velocity "
            f"(VSTART, 2010h: {config.start_velocity} steps/s) (manual §1.5).",
        )


def _eight_points(config: AxisFields) -> Iterator[BrokenRule]:
    for name, number, value in (("ramp_d1", "2013h", config.d1), ("ramp_d2", "2018h", config.d2)):
        if not 1 <= value <= HIGHEST_RATE:
            yield BrokenRule(
                name,
                f"{name[-2:]}_not_0",
                f"{name} ({number}) must be 1..{HIGHEST_RATE} steps/s2, not {value}: it must not be 0 even "
                "where V1 and V2 are (manual §1.5).",
            )
    if config.ramp_v1 > config.ramp_v2:
        yield BrokenRule(
            "ramp_v1",
            "v1_at_most_v2",
            "ramp_v1 (2012h) must be at most ramp_v2 (2017h); both 0 switch the EightPoint ramp off "
            "(manual §1.5).",
        )
    if config.ramp_v1 and not config.ramp_a1:
        yield BrokenRule(
            "ramp_a1",
            "a1_not_0",
            "ramp_a1 (2011h) must not be 0 where ramp_v1 is above 0: no move would run.",
        )
    if config.ramp_v2 > config.ramp_v1 and not config.ramp_a2:
        yield BrokenRule(
            "ramp_a2",
            "a2_not_0",
            "ramp_a2 (2016h) must not be 0 where ramp_v2 is above ramp_v1: no move would run.",
        )


def _maxima(config: AxisFields) -> Iterator[BrokenRule]:
    for name, row in SETTINGS.items():
        if row.maximum is None:
            continue
        value: int | None = getattr(config, name)
        highest: int = getattr(config, row.maximum)
        if value is not None and value > highest:
            yield BrokenRule(
                name, row.maximum, f"{name} ({value} steps) must be at most {row.maximum} ({highest} steps)."
            )


def _positions(config: AxisFields) -> Iterator[BrokenRule]:
    if not INT32_MIN <= config.home_offset <= INT32_MAX:
        yield BrokenRule("home_offset", "range_607Ch", "home_offset must fit 32 bits (607Ch).")
    if config.position_tolerance < 0:
        yield BrokenRule("position_tolerance", "not_negative", "position_tolerance must not be negative.")
    if config.soft_limits is not None:
        low, high = config.soft_limits
        if not INT32_MIN <= low < high <= INT32_MAX:
            yield BrokenRule(
                "soft_limits",
                "lower_below_upper",
                "soft_limits must be the lowest and the highest target, in this order, and fit 32 bits "
                "(607Dh).",
            )
    if not 0 <= config.switch_parameters <= 63:
        yield BrokenRule("switch_parameters", "range_2005h", "switch_parameters must be 0..63 (2005h).")
