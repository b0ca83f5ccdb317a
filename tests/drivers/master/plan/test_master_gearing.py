"""Gearing and configuration: which units an axis has, and which gearings are refused."""

from __future__ import annotations

from fractions import Fraction

import pytest

from drivers.errors import BadValue
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.gearing import Gearing, exact

SPINDLE = Gearing(gear=Fraction(3), pitch_um=Fraction(5000))
TABLE = Gearing(full_steps=400, microsteps=16, gear=Fraction(90), direction=-1)


def test_a_length_follows_from_gear_and_pitch() -> None:
    axis = AxisConfig("x", unit="mm", gearing=SPINDLE)
    assert axis.units["turns"] == 3 * 51_200
    assert axis.units["deg"] == Fraction(3 * 51_200, 360)
    assert axis.units["mm"] == axis.steps_per_unit == Fraction(3 * 51_200, 5)
    assert axis.units["um"] == axis.units["µm"] == axis.units["mm"] / 1000
    assert axis.units["steps"] == 1


def test_an_angle_needs_no_pitch_and_a_direction_turns_it_around() -> None:
    axis = AxisConfig("x", unit="deg", gearing=TABLE)
    assert axis.steps_per_unit == -400 * 16 * 90 // 360
    assert axis.units["steps"] == 1, "steps are the motor's own"
    with pytest.raises(BadValue, match="pitch"):
        AxisConfig("x", unit="mm", gearing=TABLE)


def test_units_follow_from_steps_per_unit_too() -> None:
    assert AxisConfig("x", unit="mm", steps_per_unit=1000.0).units["um"] == 1
    assert AxisConfig("x", unit="turns", steps_per_unit=51_200).units["deg"] == Fraction(51_200, 360)
    assert set(AxisConfig("x", unit="inch", steps_per_unit=2.0).units) == {"steps", "inch"}


def test_a_decimal_is_taken_as_written() -> None:
    assert exact(0.1) == Fraction(1, 10)
    assert AxisConfig("x", unit="deg", steps_per_unit=142.2222).steps_per_unit == Fraction(1_422_222, 10_000)


@pytest.mark.parametrize(
    ("gearing", "rule"),
    [
        (Gearing(full_steps=0), "2001h"),
        (Gearing(full_steps=65_536), "2001h"),
        (Gearing(microsteps=3), "2000h"),
        (Gearing(microsteps=512), "2000h"),
        (Gearing(gear=Fraction(0)), "gear"),
        (Gearing(gear=Fraction(-3)), "gear"),
        (Gearing(gear=Fraction(10**15 + 2, 7)), "gear"),
        (Gearing(pitch_um=Fraction(0)), "pitch"),
        (Gearing(direction=0), "direction"),
    ],
)
def test_a_gearing_that_can_t_be_is_refused_by_its_rule(gearing: Gearing, rule: str) -> None:
    with pytest.raises(BadValue, match=rule):
        AxisConfig("x", gearing=gearing)
