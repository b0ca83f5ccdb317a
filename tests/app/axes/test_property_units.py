"""Units over every step of 32 bits and every gearing: nothing is lost on the way out and back."""

from __future__ import annotations

from fractions import Fraction
from unittest.mock import Mock

from hypothesis import given
from hypothesis import strategies as st

from app.axes.units import Scale
from app.moves.meant import Meant
from drivers.master.axis.axis import Axis
from drivers.master.plan.configuration import INT32_MAX, INT32_MIN, AxisConfig
from drivers.master.plan.gearing import Gearing, exact
from drivers.master.plan.requests import OnBusy

STEPS = st.integers(INT32_MIN, INT32_MAX)
RATIOS = st.fractions(Fraction(1, 10**6), 10**6, max_denominator=10**6)
UNITS = st.sampled_from(("mm", "um", "deg", "turns", "steps"))
GEARINGS = st.builds(
    Gearing,
    full_steps=st.integers(1, 65_535),
    microsteps=st.integers(0, 8).map(lambda exponent: 1 << exponent),
    gear=RATIOS,
    pitch_um=RATIOS.map(lambda ratio: ratio * 1000),
    direction=st.sampled_from((1, -1)),
)
PLACES = st.floats(INT32_MIN, INT32_MAX)
"""In steps and parts of a step."""


@given(STEPS, GEARINGS, UNITS)
def test_steps_come_back_from_any_unit(steps: int, gearing: Gearing, unit: str) -> None:
    axis = AxisConfig("x", gearing=gearing)
    scale = Scale.named(unit, axis)
    shown = scale.quantity(steps)
    assert shown.steps == steps
    back = Scale(unit, scale.ratio).exact("position", shown.value if unit != "steps" else steps)
    assert round(back) == steps


@given(PLACES, GEARINGS, UNITS.filter(lambda unit: unit != "steps"))
def test_what_is_commanded_is_at_most_half_a_step_from_what_was_asked(
    place: float, gearing: Gearing, unit: str
) -> None:
    scale = Scale.named(unit, AxisConfig("x", gearing=gearing))
    number = float(Fraction(place) / scale.ratio)
    steps = scale.steps("target", number)
    assert abs(steps - exact(number) * scale.ratio) <= Fraction(1, 2)
    told = scale.commanded("target", number, steps)
    assert told["target_steps"] == steps
    missing = (Fraction(steps) / scale.ratio - exact(number)) * scale.ratio
    assert abs(float(missing) - told["rounded_by"] * float(scale.ratio)) < 1e-6


def standing_at(position: int) -> Mock:
    axis = Mock(spec=Axis, last=None)
    axis.status.position, axis.status.moving = position, False
    return axis


@given(st.lists(st.fractions(-10, 10, max_denominator=97), min_size=1, max_size=50), STEPS)
def test_relative_moves_never_drift_from_the_sum_of_what_was_asked(
    distances: list[Fraction], start: int
) -> None:
    meant, axis = Meant(), standing_at(start)
    for distance in distances:
        steps, aim = meant.target(axis, distance, OnBusy.REJECT, relative=True)
        meant.sent(axis, aim)
        axis.status.position += steps
    assert abs(axis.status.position - start - sum(distances)) <= Fraction(1, 2)


@given(STEPS, st.integers(1, 100))
def test_an_axis_that_was_moved_otherwise_starts_from_where_it_stands(start: int, elsewhere: int) -> None:
    meant, axis = Meant(), standing_at(start)
    _, aim = meant.target(axis, Fraction(1, 3), OnBusy.REJECT, relative=True)
    meant.sent(axis, aim)
    axis.status.position = start + elsewhere
    assert meant.target(axis, Fraction(1, 3), OnBusy.REJECT, relative=True) == (
        0,
        start + elsewhere + Fraction(1, 3),
    )
