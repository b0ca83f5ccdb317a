"""Profile velocity and the cyclic modes on a simulated axis; changes of mode (manual §5.1.6, §7, §9, §10)."""

from __future__ import annotations

import pytest
from sim_motion_bench import Bench

from drivers.cia402.power import PowerState
from drivers.sim.motion.travel import AxisSettings


def test_the_manuals_example_in_pv() -> None:
    bench = Bench()
    bench.write(0x2005, 3)
    bench.write(0x6060, 3)
    bench.ramp(acceleration=200_000)
    bench.control(6, 7, 15)
    bench.write(0x60FF, 100_000)
    assert not bench.bit(10)
    bench.wait(0.25)
    assert bench.velocity == 50_000
    bench.wait(0.25)
    assert (bench.velocity, bench.bit(10)) == (100_000, True)
    assert bench.position == pytest.approx(25_000, abs=1)
    bench.write(0x60FF, 0)
    bench.wait_for_events()
    assert (bench.velocity, bench.position) == (0, pytest.approx(50_000, abs=1))
    assert bench.bit(10)


def test_pv_uses_the_acceleration_both_ways_and_not_6084h() -> None:
    bench = Bench()
    bench.ramp(acceleration=100_000, deceleration=1)
    bench.enable(3)
    bench.write(0x60FF, 100_000)
    bench.wait(1.0)
    bench.write(0x60FF, 0)
    bench.wait(1.01)
    assert bench.velocity == 0


def test_pv_without_acceleration_does_not_move() -> None:
    bench = Bench()
    bench.enable(3)
    bench.write(0x60FF, 1000)
    bench.wait(5.0)
    assert (bench.position, bench.bit(10)) == (0, False)


def test_pv_turns_round_through_standstill_and_the_ramp_wait_time() -> None:
    bench = Bench()
    bench.ramp(acceleration=100_000)
    bench.write(0x2010, 1000)
    bench.write(0x6082, 1000)
    bench.write(0x2015, 31_250)
    bench.enable(3)
    bench.write(0x60FF, 50_000)
    bench.wait(0.49)
    assert bench.velocity == 50_000
    bench.write(0x60FF, -50_000)
    bench.wait(0.485)
    assert 0 < bench.velocity <= 2000
    bench.wait(0.5)
    assert (bench.velocity, bench.bit(14)) == (0, False)
    bench.wait(0.51)
    assert -2000 < bench.velocity <= -1000
    bench.wait(0.5)
    assert (bench.velocity, bench.bit(10)) == (-50_000, True)


def test_pv_halts_and_goes_on() -> None:
    bench = Bench()
    bench.ramp(acceleration=100_000)
    bench.enable(3)
    bench.write(0x60FF, 50_000)
    bench.wait(1.0)
    bench.control(0x10F)
    bench.wait(0.6)
    assert (bench.velocity, bench.bit(10), bench.state) == (0, True, PowerState.OPERATION_ENABLED)
    bench.write(0x60FF, 20_000)
    bench.wait(1.0)
    assert bench.velocity == 0
    bench.control(0x0F)
    bench.wait(1.0)
    assert bench.velocity == 20_000


def test_mode_0_stops_a_running_motor() -> None:
    bench = Bench()
    bench.ramp(acceleration=100_000)
    bench.enable(3)
    bench.write(0x60FF, 50_000)
    bench.wait(1.0)
    bench.write(0x6060, 0)
    assert bench.read(0x6061) == 3
    bench.wait(0.6)
    assert (bench.velocity, bench.read(0x6061), bench.state) == (0, 0, PowerState.OPERATION_ENABLED)


def test_another_mode_in_a_move_comes_after_the_ramp_down() -> None:
    bench = Bench()
    bench.ramp(acceleration=100_000)
    bench.enable(1)
    bench.move(500_000)
    bench.wait(1.0)
    bench.write(0x60FF, -10_000)
    bench.write(0x6060, 3)
    assert bench.read(0x6061) == 1
    bench.wait(2.0)
    assert (bench.read(0x6061), bench.velocity) == (3, -10_000)


def test_csp_reaches_each_target_within_the_period() -> None:
    bench = Bench()
    bench.write(0x60C2, 10, sub=1)
    bench.write(0x607A, 0)
    bench.enable(8)
    assert bench.bit(12)
    for cycle in range(1, 20):
        bench.write(0x607A, cycle * 100)
        bench.axis.sync(bench.now)
        bench.wait(0.005)
        assert bench.velocity == 10_000
        assert bench.demand == cycle * 100 - 50
        bench.wait(0.005)
        assert bench.demand == cycle * 100
    bench.wait(0.001)
    assert (bench.velocity, bench.demand) == (0, 1900)


def test_csp_adds_the_offset_and_stays_within_the_software_limits() -> None:
    bench = Bench()
    bench.write(0x607D, -1000, sub=1)
    bench.write(0x607D, 1000, sub=2)
    bench.enable(8)
    bench.write(0x60B0, 30)
    bench.write(0x607A, 500)
    bench.wait(0.01)
    assert (bench.position, bench.bit(11)) == (530, False)
    bench.write(0x607A, 5000)
    bench.wait(0.01)
    assert (bench.position, bench.bit(11), bench.heard()) == (1000, True, [])


def test_csp_moves_to_no_old_target_when_it_is_enabled() -> None:
    bench = Bench()
    bench.write(0x607A, 5000)
    bench.enable(8)
    bench.axis.sync(bench.now)
    bench.wait(1.0)
    assert bench.position == 0


def test_csv_reaches_each_velocity_within_the_period_and_keeps_it() -> None:
    bench = Bench()
    bench.write(0x60C2, 100, sub=1)
    bench.enable(9)
    bench.write(0x60B1, 500)
    bench.write(0x60FF, 9500)
    bench.wait(0.05)
    assert bench.velocity == 5000
    bench.wait(1.05)
    assert (bench.velocity, bench.bit(12)) == (10_000, True)
    bench.write(0x60FF, -10_500)
    bench.wait(0.05)
    assert bench.velocity == pytest.approx(0, abs=1)
    bench.wait(0.05)
    assert bench.velocity == -10_000
    bench.control(0x10F)
    bench.wait(1.0)
    assert (bench.velocity, bench.bit(12)) == (0, False)


def test_a_velocity_beyond_32_bits_is_shown_as_the_largest() -> None:
    bench = Bench(AxisSettings(negative_limit=None, travel_min=None))
    bench.enable(8)
    bench.write(0x607A, -(2**31))
    assert bench.velocity == -(2**31)
    bench.wait(0.001)
    assert bench.demand == -(2**31)
