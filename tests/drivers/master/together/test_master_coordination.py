"""Scaling several axes to one time, against the module's own ramps."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.devices.ramp import Ramp, plan_move
from drivers.devices.trajectory import Trajectory
from drivers.errors import BadValue
from drivers.master.together.coordination import END_VELOCITY, Profile, Way, coordinate

RATES = st.integers(1000, 16_777_215)


@st.composite
def ways(draw: st.DrawFn) -> Way:
    return Way(
        distance=draw(st.integers(1, 3_000_000)),
        velocity=draw(st.integers(1000, 400_000)),
        acceleration=draw(RATES),
        deceleration=draw(RATES),
    )


def ramp(way: Way, profile: Profile) -> Trajectory:
    """As the module makes it."""
    shape = Ramp.trapezoid(
        profile.velocity,
        profile.acceleration,
        profile.deceleration,
        0,
        END_VELOCITY,
    )
    return plan_move(0.0, 0.0, 0.0, way.distance, shape)


@settings(max_examples=20, deadline=None)
@given(st.lists(ways(), min_size=1, max_size=3))
def test_all_take_the_same_time_and_never_more_than_asked(chosen: list[Way]) -> None:
    plan = coordinate(chosen)
    for way, profile in zip(chosen, plan.profiles, strict=True):
        assert 1 <= profile.velocity <= way.velocity
        assert 1 <= profile.acceleration <= way.acceleration
        assert 1 <= profile.deceleration <= way.deceleration
        lasts = ramp(way, profile).duration
        assert lasts == pytest.approx(profile.duration_s, abs=1e-4)
        if plan.duration_s < min(20, way.distance / 20):  # else a speed is a coarse thing
            assert lasts == pytest.approx(plan.duration_s, abs=0.010)
        else:
            assert lasts <= plan.duration_s + 0.01 or way.distance < 20


@settings(max_examples=20, deadline=None)
@given(st.lists(ways(), min_size=2, max_size=3))
def test_the_slowest_axis_is_not_slowed_down(chosen: list[Way]) -> None:
    alone = max(way.duration(way.velocity, way.acceleration, way.deceleration) for way in chosen)
    together = coordinate(chosen).duration_s
    assert together >= alone - 1e-9


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(10_000, 1_000_000), min_size=2, max_size=3), st.floats(0.1, 30))
def test_the_axes_stay_on_a_straight_line(distances: list[int], at_least: float) -> None:
    chosen = [Way(d, 51_200, 102_400, 204_800) for d in distances]
    plan = coordinate(chosen, at_least)
    assert plan.duration_s >= at_least
    tracks = [ramp(w, p) for w, p in zip(chosen, plan.profiles, strict=True)]
    for tenth in range(1, 10):
        at = plan.duration_s * tenth / 10
        shares = [t.position(at) / w.distance for t, w in zip(tracks, chosen, strict=True)]
        assert max(shares) - min(shares) < 0.03, (plan, shares)


def test_equal_axes_get_equal_numbers_and_the_limits_are_used_up() -> None:
    way = Way(51_200, 20_000, 40_000, 80_000)
    plan = coordinate([way, way])
    assert [(p.velocity, p.acceleration, p.deceleration) for p in plan.profiles] == [
        (20_000, 40_000, 80_000)
    ] * 2


def test_half_the_way_gets_half_the_numbers() -> None:
    plan = coordinate([Way(50_000, 20_000, 40_000, 40_000), Way(25_000, 20_000, 40_000, 40_000)])
    assert plan.profiles[1].velocity == pytest.approx(10_000, rel=1e-3)
    assert plan.profiles[1].acceleration == pytest.approx(20_000, rel=1e-3)
    assert plan.spread_s < 0.001


def test_a_duration_is_kept_and_one_that_no_axis_can_take_is_refused() -> None:
    pair = [Way(10_000, 51_200, 102_400, 102_400), Way(400, 51_200, 102_400, 102_400)]
    plan = coordinate(pair, 12.5)
    assert plan.duration_s == 12.5
    assert all(p.duration_s == pytest.approx(12.5, abs=0.005) for p in plan.profiles)
    with pytest.raises(BadValue, match="1 step/s"):
        coordinate(pair, 10_002.0)


def test_a_single_step_beside_a_long_way_arrives_early_and_the_plan_says_so() -> None:
    plan = coordinate([Way(500_000, 51_200, 102_400, 102_400), Way(1, 51_200, 102_400, 102_400)])
    assert plan.profiles[1].duration_s == pytest.approx(1.414, abs=0.1)
    assert plan.spread_s > 8
