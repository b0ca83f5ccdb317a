"""Profile position mode on a simulated axis (manual §6)."""

from __future__ import annotations

import math

import pytest
from sim_motion_bench import Bench

from drivers.cia402.power import PowerState


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.ramp(velocity=50_000, acceleration=100_000)
    bench.enable(1)
    return bench


def test_the_manuals_example_moves_to_half_a_million() -> None:
    bench = Bench()
    bench.write(0x2005, 3)
    bench.write(0x6060, 1)
    bench.ramp(velocity=100_000, acceleration=200_000)
    bench.control(6, 7, 15)
    bench.write(0x607A, 500_000)
    bench.control(31)
    assert bench.bit(12)
    assert not bench.bit(10)
    bench.control(15)
    bench.wait(0.25)
    assert bench.velocity == 50_000
    began = bench.now - 0.25
    bench.wait_for_events()
    assert bench.now - began == pytest.approx(500_000 / 100_000 + 0.5, abs=1e-3)
    assert (bench.position, bench.demand, bench.velocity) == (500_000, 500_000, 0)
    assert bench.bit(10)
    assert not bench.bit(12)


def test_a_short_move_never_reaches_the_profile_velocity(bench: Bench) -> None:
    bench.move(1000)
    began = bench.now
    bench.wait(math.sqrt(1000 / 100_000))
    assert bench.velocity == pytest.approx(10_000, rel=0.01)
    bench.wait_for_events()
    assert bench.now - began == pytest.approx(0.2, abs=1e-3)
    assert bench.position == 1000


def test_a_move_to_where_it_stands_is_in_process_for_an_instant(bench: Bench) -> None:
    bench.move(0)
    assert bench.bit(12)
    assert not bench.bit(10)
    bench.wait(0.002)
    assert not bench.bit(12)
    assert bench.bit(10)


def test_writing_a_target_or_holding_bit_4_starts_nothing(bench: Bench) -> None:
    bench.write(0x607A, 1000)
    bench.wait(1.0)
    assert bench.position == 0
    bench.control(31)
    bench.wait(1.0)
    bench.write(0x607A, 2000)
    bench.control(31)
    bench.wait(1.0)
    assert bench.position == 1000


def test_bit_4_counts_in_operation_enabled_only() -> None:
    bench = Bench()
    bench.ramp()
    bench.write(0x6060, 1)
    bench.write(0x607A, 1000)
    bench.control(6, 7, 0x17, 0x0F)
    bench.wait(1.0)
    assert (bench.state, bench.position) == (PowerState.OPERATION_ENABLED, 0)


def test_zero_parameters_leave_the_set_point_in_process(bench: Bench) -> None:
    for index in (0x6081, 0x6083, 0x6084):
        value = bench.parameters.get(index)
        bench.write(index, 0)
        bench.move(1000)
        bench.wait(10.0)
        assert (bench.position, bench.bit(12), bench.bit(10)) == (0, True, False)
        assert bench.axis.next_event(bench.now) is None
        bench.write(index, value)
    bench.move(1000)
    bench.wait_for_events()
    assert bench.position == 1000


def test_relative_to_the_preceding_target_the_demand_and_the_actual_position(bench: Bench) -> None:
    bench.move(10_000)
    bench.wait(0.1)
    bench.move(5000, relative=True)
    bench.wait_for_events()
    assert bench.position == 15_000
    for option in (1, 2):
        bench.write(0x60F2, option)
        bench.move(50_000)
        bench.wait(0.2)
        here = bench.demand
        bench.move(20_000, relative=True)
        bench.wait_for_events()
        assert bench.position == here + 20_000
        bench.move(15_000)
        bench.wait_for_events()


def test_a_new_set_point_takes_effect_on_the_fly_and_turns_round(bench: Bench) -> None:
    bench.write(0x2015, 31_250)
    bench.move(400_000)
    bench.wait(2.0)
    began, here = bench.now, bench.demand
    bench.move(0)
    assert bench.velocity == 50_000
    bench.wait(0.5)
    assert bench.velocity == 0
    assert bench.demand == pytest.approx(here + 12_500, abs=2)
    bench.wait(0.9)
    assert not bench.bit(14)
    assert bench.bit(12)
    bench.wait_for_events()
    way = here + 12_500
    assert bench.now - began == pytest.approx(0.5 + 1.0 + way / 50_000 + 0.5, abs=2e-3)
    assert (bench.position, bench.bit(10)) == (0, True)


def test_halt_ramps_down_stays_enabled_and_its_release_resumes(bench: Bench) -> None:
    bench.move(200_000)
    bench.wait(1.0)
    bench.control(0x10F)
    assert not bench.bit(10)
    bench.wait(0.6)
    assert (bench.velocity, bench.state) == (0, PowerState.OPERATION_ENABLED)
    assert bench.bit(10)
    assert bench.bit(12)
    assert 0 < bench.position < 200_000
    bench.control(0x0F)
    bench.wait_for_events()
    assert bench.position == 200_000


def test_a_quick_stop_drops_the_set_point_for_good(bench: Bench) -> None:
    bench.move(200_000)
    bench.wait(1.0)
    bench.control(2)
    bench.wait_for_events()
    stopped = bench.position
    assert not bench.bit(12)
    assert not bench.bit(10)
    bench.control(6, 7, 15)
    bench.wait(5.0)
    assert bench.position == stopped
    bench.move(100, relative=True)
    bench.wait_for_events()
    assert bench.position == stopped + 100


def test_position_window_and_dwell_time(bench: Bench) -> None:
    bench.write(0x6067, 500)
    bench.write(0x6068, 300)
    bench.move(50_000)
    began = bench.now
    # The last 500 microsteps of a ramp down with 100000/s2 take sqrt(2 * 500 / 100000) s.
    entered = 50_000 / 50_000 + 0.5 - math.sqrt(2 * 500.5 / 100_000)
    bench.wait(entered + 0.3 - 0.002)
    assert not bench.bit(10)
    bench.wait(0.004)
    assert bench.bit(10)
    assert bench.now - began == pytest.approx(entered + 0.302)
    bench.wait_for_events()
    bench.move(50_100)
    assert not bench.bit(10)
    bench.wait(0.31)
    assert bench.bit(10)


def test_software_limits_corrected_by_the_home_offset_cut_targets_down(bench: Bench) -> None:
    bench.write(0x607D, -1000, sub=1)
    bench.write(0x607D, 20_000, sub=2)
    bench.write(0x607C, 5000)
    bench.move(50_000)
    assert bench.bit(11)
    bench.wait_for_events()
    assert (bench.position, bench.bit(10)) == (15_000, True)
    bench.move(-50_000)
    bench.wait_for_events()
    assert (bench.position, bench.heard()) == (-6000, [])
    bench.move(0)
    assert not bench.bit(11)


def test_internal_units_scale_velocities_and_accelerations() -> None:
    bench = Bench()
    bench.write(0x208C, 0)
    assert bench.read(0x208E) == 0
    bench.ramp(velocity=10_000, acceleration=10_000)
    bench.enable(1)
    bench.move(1_000_000)
    bench.wait(10.0)
    assert bench.velocity == 10_000
    assert bench.axis.motor.velocity(bench.now) == pytest.approx(10_000 * 16e6 / 2**24)


def test_an_eight_point_ramp_shapes_the_move(bench: Bench) -> None:
    for index, value in (
        (0x2011, 20_000),
        (0x2012, 10_000),
        (0x2013, 10_000),
        (0x2016, 50_000),
        (0x2017, 30_000),
        (0x2018, 40_000),
    ):
        bench.write(index, value)
    bench.move(200_000)
    bench.wait(0.5)
    assert bench.velocity == 10_000
    bench.wait(0.4)
    assert bench.velocity == 30_000
    bench.wait(0.2)
    assert bench.velocity == 50_000
    up = (10_000**2 / 40_000) + (30_000**2 - 10_000**2) / 100_000 + (50_000**2 - 30_000**2) / 200_000
    down = 10_000**2 / 20_000 + (30_000**2 - 10_000**2) / 80_000 + (50_000**2 - 30_000**2) / 200_000
    cruise = (200_000 - up - down) / 50_000
    began = bench.now - 1.1
    bench.wait_for_events()
    assert bench.now - began == pytest.approx(1.1 + cruise + 0.2 + 0.5 + 1.0 - 0.001, abs=1e-3)
    assert bench.position == 200_000
