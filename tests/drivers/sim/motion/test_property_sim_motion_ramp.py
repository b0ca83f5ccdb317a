"""Ramps against another computation: time and way as integrals over the speed, the peak by bisection."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drivers.devices.ramp import Ramp, bands, plan_follow, plan_move, plan_stop, plan_velocity
from drivers.devices.trajectory import Trajectory
from drivers.sim.motion.goals import MoveTo

SPEEDS = st.integers(10, 2_000_000)
RATES = st.integers(100, 16_777_215)
TARGETS = st.integers(-20_000_000, 20_000_000)


def rate_at(speed: float, v1: float, v2: float, rates: tuple[float, float, float]) -> float:
    """Manual §1.5: the first rate up to V1, the second up to V2, the third above."""
    if speed < v1:
        return rates[0]
    return rates[1] if speed < v2 else rates[2]


def integrate(
    low: float, high: float, v1: float, v2: float, rates: tuple[float, float, float]
) -> tuple[float, float]:
    """(time, way) between two speeds: the midpoint rule on each piece without a kink is exact."""
    time = way = 0.0
    edges = sorted({low, high, *(v for v in (v1, v2) if low < v < high)})
    for a, b in pairwise(edges):
        middle = (a + b) / 2
        rate = rate_at(middle, v1, v2, rates)
        time += (b - a) / rate
        way += middle * (b - a) / rate
    return time, way


def expected_duration(
    way: float,
    start: float,
    stop: float,
    top: float,
    v1: float,
    v2: float,
    up: tuple[float, float, float],
    down: tuple[float, float, float],
) -> float:
    def ways(peak: float) -> float:
        return sum(
            integrate(min(first, peak), peak, v1, v2, rates)[1]
            for first, rates in ((start, up), (stop, down))
        )

    peak = top
    if ways(top) > way:
        low, high = 0.0, top
        for _ in range(200):
            peak = (low + high) / 2
            low, high = (peak, high) if ways(peak) < way else (low, peak)
    time = sum(
        integrate(min(first, peak), peak, v1, v2, rates)[0] for first, rates in ((start, up), (stop, down))
    )
    cruise = way - ways(peak)
    return time + (cruise / peak if cruise > 0 and peak == top else 0.0)


@settings(max_examples=300, deadline=None)
@given(
    target=TARGETS, top=SPEEDS, up=RATES, down=RATES, start=st.integers(0, 1000), over=st.integers(0, 1000)
)
def test_a_trapezoid_takes_the_textbook_time_and_lands_on_the_microstep(
    target: int, top: int, up: int, down: int, start: int, over: int
) -> None:
    stop = max(start + over, 10)
    assume(target != 0)
    leg = plan_move(5.0, 0.0, 0.0, target, Ramp.trapezoid(top, up, down, start, stop))
    expected = expected_duration(
        abs(target), min(start, top), min(stop, top), top, 0, 0, (up, up, up), (down, down, down)
    )
    assert leg.duration == pytest.approx(expected, abs=1e-3)
    assert leg.end == target
    assert leg.position(leg.finish) == target


@settings(max_examples=300, deadline=None)
@given(
    target=TARGETS,
    top=SPEEDS,
    v1=SPEEDS,
    above=SPEEDS,
    up=st.tuples(RATES, RATES, RATES),
    down=st.tuples(RATES, RATES, RATES),
    start=st.integers(0, 1000),
    over=st.integers(10, 1000),
)
def test_an_eight_point_ramp_agrees_with_integration_over_the_speed(
    target: int,
    top: int,
    v1: int,
    above: int,
    up: tuple[int, int, int],
    down: tuple[int, int, int],
    start: int,
    over: int,
) -> None:
    assume(target != 0)
    v2, stop = v1 + above, start + over
    ramp = Ramp(start, stop, top, bands(v1, v2, *up), bands(v1, v2, *down))
    leg = plan_move(0.0, 0.0, 0.0, target, ramp)
    expected = expected_duration(abs(target), min(start, top), min(stop, top), top, v1, v2, up, down)
    assert leg.duration == pytest.approx(expected, abs=1e-3)
    assert leg.end == target
    assert_consistent(leg)


@settings(max_examples=200, deadline=None)
@given(
    target=TARGETS,
    ramp=st.builds(Ramp.trapezoid, SPEEDS, RATES, RATES, st.just(0), st.integers(10, 500)),
    later=TARGETS,
    share=st.floats(0.0, 1.0),
)
def test_a_target_changed_on_the_fly_is_reached_exactly_in_at_most_two_legs(
    target: int, ramp: Ramp, later: int, share: float
) -> None:
    first = plan_move(0.0, 0.0, 0.0, target, ramp)
    at = first.duration * share
    leg = plan_move(at, first.position(at), first.velocity(at), later, ramp)
    assert_consistent(leg)
    if not MoveTo(later, ramp).reached_by(leg):
        stopped = leg.end
        assert stopped == round(stopped)
        leg = plan_move(leg.finish, stopped, 0.0, later, ramp)
    assert leg.end == later
    assert leg.rests


@settings(max_examples=200, deadline=None)
@given(
    velocity=st.floats(-1e6, 1e6), rate=RATES, stop=st.integers(0, 1000), origin=st.integers(-(10**6), 10**6)
)
def test_a_stop_takes_speed_over_rate_and_ends_within_a_microstep_of_the_textbook(
    velocity: float, rate: int, stop: int, origin: int
) -> None:
    assume(abs(velocity) > 1)
    leg = plan_stop(0.0, float(origin), velocity, rate, stop)
    ramped = max(abs(velocity) - stop, 0.0)
    low = min(stop, abs(velocity))
    way = math.copysign((velocity**2 - low**2) / (2 * rate), velocity)
    assert leg.duration == pytest.approx(ramped / rate, abs=1e-3)
    assert abs(leg.end - (origin + way)) <= 1.001
    assert leg.end == round(leg.end)
    assert_consistent(leg)


@given(velocity=st.integers(-100_000, 100_000), target=st.integers(-100_000, 100_000), rate=RATES)
def test_a_velocity_ramp_reaches_its_velocity_or_stops_before_turning(
    velocity: int, target: int, rate: int
) -> None:
    leg = plan_velocity(0.0, 0.0, float(velocity), float(target), rate)
    if velocity * target < 0 or not target:
        assert leg.rests
    else:
        assert leg.final_velocity == target
        assert leg.duration == pytest.approx(abs(target - velocity) / rate)
        assert leg.velocity(leg.finish + 10) == target
    assert_consistent(leg)


def test_a_cyclic_set_point_is_reached_at_constant_speed() -> None:
    leg = plan_follow(1.0, 100.0, 140, 0.004)
    assert leg.finish == pytest.approx(1.004)
    assert leg.velocity(1.002) == pytest.approx(10_000)
    assert leg.position(1.002) == pytest.approx(120)


def assert_consistent(leg: Trajectory) -> None:
    """Monotone; the velocity is the position's slope; `time_at` is the inverse of `position`."""
    if not leg.direction:
        return
    times = [leg.start + leg.duration * i / 64 for i in range(65)]
    positions = [leg.position(t) for t in times]
    for before, after in pairwise(positions):
        assert (after - before) * leg.direction >= -1e-6
    for t, position in zip(times, positions, strict=True):
        assert leg.velocity(t) * leg.direction >= -1e-6
        found = leg.time_at(position)
        assert found is not None
        assert leg.position(found) == pytest.approx(position, abs=1e-3)
