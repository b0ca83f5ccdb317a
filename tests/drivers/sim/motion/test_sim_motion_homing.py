"""All homing methods on a simulated travel (manual §8)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from sim_motion_bench import Bench

from drivers.cia402.power import PowerState
from drivers.sim.motion.travel import AxisSettings

TRAVEL = AxisSettings(
    travel_min=-105_000,
    travel_max=105_000,
    negative_limit=-100_000,
    positive_limit=100_000,
    home=(20_000, 24_000),
    index_pitch=3200,
    index_phase=800,
)


def next_index(place: int, direction: int) -> int:
    """By counting."""
    place += direction
    while (place - 800) % 3200:
        place += direction
    return place


def homing(start: int, method: int, *, fast: int = 50_000, slow: int = 5000, **settings: Any) -> Bench:
    bench = Bench(replace(TRAVEL, start=start, **settings))
    bench.write(0x6098, method)
    bench.write(0x6099, fast, sub=1)
    bench.write(0x6099, slow, sub=2)
    bench.write(0x609A, 200_000)
    bench.enable(6)
    return bench


EDGES = {1: -99_999, 2: 99_999, 3: 19_999, 5: 24_001, 17: -99_999, 18: 99_999, 19: 19_999, 21: 24_001}
LEFT_TOWARDS = {1: 1, 2: -1, 3: -1, 5: 1}
STARTS = (0, -99_990, 99_990, 19_000, 20_000, 22_000, 24_000, 30_000, -100_500, 100_500)


def home_of(method: int, start: int) -> int:
    if method in LEFT_TOWARDS:
        return next_index(EDGES[method], LEFT_TOWARDS[method])
    return EDGES[method] if method in EDGES else next_index(start, -1 if method == 33 else 1)


CASES = [
    (method, start, home)
    for method in (*EDGES, 33, 34)
    for start in STARTS
    if abs(home := home_of(method, start)) < 100_000
]


@pytest.mark.parametrize(("method", "start", "home"), CASES)
def test_every_method_finds_home_from_everywhere(method: int, start: int, home: int) -> None:
    bench = homing(start, method)
    bench.write(0x607C, 1234)
    bench.control(31)
    assert not bench.bit(10)
    assert not bench.bit(12)
    bench.wait_for_events(200)
    assert bench.bit(10)
    assert bench.bit(12)
    assert not bench.bit(13)
    assert (bench.velocity, bench.heard()) == (0, [])
    assert bench.axis.motor.place(bench.now) == home
    assert bench.position == bench.demand == -1234
    bench.control(15)
    assert bench.bit(12)
    assert bench.state is PowerState.OPERATION_ENABLED


def test_after_homing_the_zero_position_lies_the_home_offset_away() -> None:
    bench = homing(0, 19)
    bench.write(0x607C, 500)
    bench.control(31)
    bench.wait_for_events()
    bench.ramp()
    bench.write(0x6060, 1)
    bench.move(0)
    bench.wait_for_events()
    assert bench.axis.motor.place(bench.now) == 19_999 + 500


def test_the_manuals_example_with_a_hand_on_the_home_switch() -> None:
    bench = Bench(AxisSettings(home=None))
    bench.write(0x6060, 6)
    bench.control(15, 6, 7)
    bench.write(0x6098, 19)
    bench.write(0x6099, 50_000, sub=1)
    bench.write(0x6099, 10_000, sub=2)
    bench.write(0x609A, 100_000)
    bench.control(31)
    assert bench.state is PowerState.OPERATION_ENABLED
    bench.wait(2.0)
    assert bench.velocity == 50_000
    bench.axis.press_switch("home", bench.now)
    assert bench.read(0x60FD) & 4
    bench.wait(2.0)
    assert bench.velocity == -10_000
    assert not bench.bit(10)
    bench.axis.release_switch("home", bench.now)
    assert (bench.bit(10), bench.bit(12), bench.velocity, bench.position) == (True, True, 0, 0)
    bench.control(15)
    assert bench.bit(12)


def test_the_search_is_fast_and_the_edge_is_left_slowly() -> None:
    bench = homing(0, 17)
    bench.control(31)
    bench.wait(1.0)
    assert bench.velocity == -50_000
    bench.wait(2.0)
    assert bench.velocity == 5000


def test_clearing_bit_4_stops_and_bit_10_alone_says_so() -> None:
    bench = homing(0, 18)
    bench.control(31)
    bench.wait(1.0)
    bench.control(15)
    assert not bench.bit(10)
    bench.wait(0.3)
    assert (bench.velocity, bench.bit(10), bench.bit(12)) == (0, True, False)
    bench.control(31)
    bench.wait_for_events()
    assert bench.bit(12)


def test_halt_means_nothing_in_homing() -> None:
    bench = homing(0, 18)
    bench.control(31, 31 | 0x100)
    bench.wait(1.0)
    assert bench.velocity == 50_000


@pytest.mark.parametrize(("fast", "slow", "rate"), [(0, 1000, 1000), (1000, 1000, 0)])
def test_with_a_zero_speed_or_acceleration_it_never_moves(fast: int, slow: int, rate: int) -> None:
    bench = homing(0, 17, fast=fast, slow=slow)
    bench.write(0x609A, rate)
    bench.control(31)
    bench.wait(1000.0)
    assert (bench.axis.motor.place(bench.now), bench.bit(10), bench.bit(12)) == (0, False, False)


def test_method_0_does_nothing() -> None:
    bench = homing(0, 0)
    bench.control(31)
    bench.wait(10.0)
    assert (bench.position, bench.bit(10), bench.bit(12)) == (0, False, False)


def test_method_35_takes_here_as_home_without_moving_and_without_being_enabled() -> None:
    bench = homing(0, 35)
    bench.write(0x6060, 1)
    bench.ramp()
    bench.move(5000)
    bench.wait_for_events()
    bench.control(0)
    bench.write(0x607C, 77)
    bench.write(0x6060, 6)
    bench.control(0x10)
    assert bench.state is PowerState.SWITCH_ON_DISABLED
    assert (bench.bit(10), bench.bit(12)) == (True, True)
    assert [bench.read(index) for index in (0x6062, 0x6063, 0x6064)] == [-77, -77, -77]
    assert bench.axis.motor.place(bench.now) == 5000
    assert bench.read(0x2100) == 77


def test_a_missing_home_switch_is_searched_to_and_fro_without_end_or_emergency() -> None:
    bench = homing(0, 19, home=None)
    bench.control(31)
    bench.wait(500.0)
    assert bench.axis.moving
    assert (bench.bit(10), bench.heard()) == (False, [])
    assert abs(bench.axis.motor.place(bench.now)) < 105_000


def test_a_fast_search_that_runs_through_a_narrow_switch_comes_back_to_the_same_edge() -> None:
    bench = homing(0, 19, home=(20_000, 20_400))
    bench.control(31)
    bench.wait_for_events()
    assert bench.axis.motor.place(bench.now) == 19_999


def test_a_disabled_limit_switch_is_never_found() -> None:
    bench = homing(0, 17)
    bench.control(0)
    bench.write(0x2005, 1)
    bench.control(6, 7, 31)
    bench.wait(100.0)
    assert bench.axis.motor.place(bench.now) == -105_000
    assert not bench.bit(10)


def test_normally_closed_switches_need_their_polarity_bits() -> None:
    bench = homing(0, 19, normally_closed=True)
    assert bench.read(0x60FD) == 0b111
    bench.control(0)
    bench.write(0x2005, 0b101100)
    assert bench.read(0x60FD) == 0
    bench.control(6, 7, 31)
    bench.wait_for_events()
    assert bench.axis.motor.place(bench.now) == 19_999


def test_an_index_search_into_a_limit_switch_is_a_fault() -> None:
    bench = homing(99_300, 34)
    bench.control(31)
    bench.wait_for_events()
    assert bench.state is PowerState.FAULT
    assert bench.heard() == [(0xFF01, 3, 0)]
    assert not bench.bit(12)


def test_leaving_the_mode_forgets_the_outcome() -> None:
    bench = homing(0, 35)
    bench.control(31)
    assert bench.bit(12)
    bench.write(0x6060, 1)
    bench.write(0x6060, 6)
    assert not bench.bit(12)


def test_a_start_that_comes_before_the_brake_is_open_waits_for_it() -> None:
    bench = homing(0, 18)
    bench.control(0)
    bench.write(0x2002, 100, sub=2)
    bench.control(6, 7, 31)
    bench.wait(0.09)
    assert bench.state is PowerState.SWITCHED_ON
    bench.wait(1.0)
    assert bench.velocity == 50_000


def test_a_bit_4_that_was_left_high_in_another_mode_starts_no_homing() -> None:
    bench = homing(0, 18)
    bench.write(0x6060, 1)
    bench.control(31)
    bench.write(0x6060, 6)
    bench.wait(1.0)
    assert bench.velocity == 0
