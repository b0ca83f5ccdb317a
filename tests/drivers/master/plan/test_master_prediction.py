"""How long motions are predicted to take."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.prediction import predict_move, predict_stop, predict_velocity

RATES = st.integers(10, 10_000_000)
PLAIN = AxisConfig(name="x", velocity=1000, acceleration=100, deceleration=100, end_velocity=10)


@given(st.integers(-(10**9), 10**9), RATES, RATES, RATES)
def test_a_move_takes_at_least_what_its_velocity_allows(
    target: int, velocity: int, acceleration: int, deceleration: int
) -> None:
    config = AxisConfig(name="x")
    seen = predict_move(
        config, 0, target, velocity=velocity, acceleration=acceleration, deceleration=deceleration
    )
    way = abs(target) / velocity
    assert seen.duration_s >= way * 0.999999
    assert seen.duration_s <= way + velocity / acceleration + velocity / deceleration + 1e-6
    assert seen.peak_velocity <= velocity * 1.000001
    assert (seen.start, seen.end) == (0, target)


def test_a_triangle_and_a_trapezoid() -> None:
    smooth = replace(PLAIN, end_velocity=10)  # the last 10 steps/s are a jump
    assert predict_move(smooth, 0, 100).duration_s == pytest.approx(2.0, rel=0.06)
    assert predict_move(smooth, 0, 2000, velocity=100).duration_s == pytest.approx(21.0, rel=0.01)
    assert predict_move(smooth, 50, 50).duration_s == 0


def test_a_velocity_is_reached_through_standstill_where_it_turns_round() -> None:
    up = predict_velocity(PLAIN, 0, 0, 500)
    assert (up.duration_s, up.peak_velocity) == (pytest.approx(5.0), 500)
    assert up.end == pytest.approx(1250, abs=1)
    back = predict_velocity(PLAIN, 0, 500, -300)
    assert back.duration_s == pytest.approx(5.0 + 3.0, rel=0.02)
    assert back.peak_velocity == 500
    assert predict_velocity(PLAIN, 7, 500, 500).duration_s == 0


def test_a_stop_takes_its_ramp() -> None:
    assert predict_stop(-1000, 500) == pytest.approx(2.0)
    assert predict_stop(0, 500) == 0
