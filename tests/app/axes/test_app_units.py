"""Units: the bridge between a user's numbers and microsteps."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.axes.units import Scale
from app.http.problems import ApiError
from drivers.master.plan.configuration import AxisConfig

MM = AxisConfig(name="x", unit="mm", steps_per_unit=51200 / 4)
PLAIN = AxisConfig(name="y")


def test_steps_are_known_to_every_axis_and_never_scaled() -> None:
    assert Scale.named("steps", MM).steps("target", 100) == 100


def test_the_axis_unit_is_scaled_and_rounded_to_the_nearest_step() -> None:
    assert Scale.named("mm", MM).steps("target", 1) == 12800
    assert Scale.named("mm", MM).steps("target", 0.00004) == 1


@pytest.mark.parametrize("value", [1.5, 1000.0])
def test_steps_are_whole(value: float) -> None:
    with pytest.raises(ApiError, match="whole"):
        Scale.named("steps", PLAIN).steps("target", value)


def test_an_unknown_unit_says_which_are_known() -> None:
    with pytest.raises(ApiError) as caught:
        Scale.named("inch", MM)
    assert caught.value.type.status == 422
    assert caught.value.hint == "Give the number in steps, mm or um."


@pytest.mark.parametrize("value", [1e308, 10**400])
def test_a_number_out_of_all_range_is_refused_without_a_crash(value: float) -> None:
    with pytest.raises(ApiError, match="range"):
        Scale.named("mm", MM).steps("target", value)


def test_a_rate_has_no_direction_and_never_becomes_nothing() -> None:
    turned = Scale("mm", -100.0)
    assert turned.rate("velocity", 2) == 200
    assert turned.rate("velocity", 1e-9) == 1
    assert turned.rate("velocity", None) is None


@given(steps=st.integers(-(2**31), 2**31 - 1), factor=st.floats(0.01, 1e6))
def test_what_is_shown_comes_back(steps: int, factor: float) -> None:
    scale = Scale("mm", factor)
    shown = scale.quantity(steps)
    assert shown.steps == steps
    assert abs(scale.steps("target", shown.value) - steps) <= 1
