"""The power state machine of a simulated axis: commands, option codes, delays (manual §5.1, §6.1)."""

from __future__ import annotations

import pytest
from sim_motion_bench import Bench

from drivers.cia402.power import PowerState

S = PowerState


def running_at(bench: Bench, velocity: int = 50_000) -> Bench:
    bench.ramp(acceleration=100_000)
    bench.enable(3)
    bench.write(0x60FF, velocity)
    bench.wait(1.0)
    assert bench.velocity == velocity
    return bench


def test_it_wakes_up_in_switch_on_disabled_with_voltage_and_remote() -> None:
    bench = Bench()
    assert bench.statusword & ~0x400 == 0x0250
    assert bench.axis.next_event(bench.now) is None
    assert not bench.axis.moving


def test_the_way_up_and_down_by_the_book() -> None:
    bench = Bench()
    for word, state in (
        (7, S.SWITCH_ON_DISABLED),
        (6, S.READY_TO_SWITCH_ON),
        (7, S.SWITCHED_ON),
        (15, S.OPERATION_ENABLED),
        (7, S.SWITCHED_ON),
        (6, S.READY_TO_SWITCH_ON),
        (15, S.OPERATION_ENABLED),
        (6, S.READY_TO_SWITCH_ON),
        (7, S.SWITCHED_ON),
        (2, S.SWITCH_ON_DISABLED),
        (6, S.READY_TO_SWITCH_ON),
        (0, S.SWITCH_ON_DISABLED),
    ):
        bench.control(word)
        assert bench.state is state, f"after {word}"


def test_disable_operation_ramps_down_first_and_then_is_switched_on() -> None:
    bench = running_at(Bench())
    bench.control(7)
    assert bench.state is S.OPERATION_ENABLED
    bench.wait(0.25)
    assert 0 < bench.velocity < 50_000
    bench.wait(0.26)
    assert (bench.state, bench.velocity) == (S.SWITCHED_ON, 0)


@pytest.mark.parametrize(("word", "state"), [(6, S.READY_TO_SWITCH_ON), (0, S.SWITCH_ON_DISABLED)])
def test_shutdown_and_disable_voltage_cut_the_power_at_speed(word: int, state: PowerState) -> None:
    bench = running_at(Bench())
    before = bench.position
    bench.control(word)
    assert (bench.state, bench.velocity) == (state, 0)
    bench.wait(1.0)
    assert abs(bench.position - before) <= 1


@pytest.mark.parametrize(
    ("option", "end", "seconds"),
    [
        (1, S.SWITCH_ON_DISABLED, 0.5),
        (2, S.SWITCH_ON_DISABLED, 0.1),
        (5, S.QUICK_STOP_ACTIVE, 0.5),
        (6, S.QUICK_STOP_ACTIVE, 0.1),
    ],
)
def test_quick_stop_by_each_option_code(option: int, end: PowerState, seconds: float) -> None:
    bench = running_at(Bench())
    bench.write(0x6085, 500_000)
    bench.write(0x605A, option)
    bench.control(2)
    assert bench.state is S.QUICK_STOP_ACTIVE
    bench.wait(seconds - 0.01)
    assert bench.velocity > 0
    bench.wait(0.02)
    assert (bench.state, bench.velocity) == (end, 0)


def test_from_quick_stop_active_there_is_a_way_back_and_pv_runs_again() -> None:
    bench = running_at(Bench())
    bench.write(0x605A, 6)
    bench.control(2)
    bench.wait(2.0)
    bench.control(15)
    bench.wait(1.0)
    assert (bench.state, bench.velocity) == (S.OPERATION_ENABLED, 50_000)


def test_enable_operation_during_a_quick_stop_that_ends_disabled_waits_and_does_nothing() -> None:
    bench = running_at(Bench())
    bench.control(2, 15)
    assert bench.state is S.QUICK_STOP_ACTIVE
    bench.wait(5.0)
    assert (bench.state, bench.velocity) == (S.SWITCH_ON_DISABLED, 0)


def test_a_command_during_the_ramp_of_disable_operation_comes_after_it() -> None:
    bench = running_at(Bench())
    bench.control(7, 6)
    assert (bench.state, bench.velocity) == (S.OPERATION_ENABLED, 50_000)
    bench.wait(0.51)
    assert bench.state is S.READY_TO_SWITCH_ON


def test_disable_voltage_overtakes_a_ramp() -> None:
    bench = running_at(Bench())
    bench.control(7, 0)
    assert (bench.state, bench.velocity) == (S.SWITCH_ON_DISABLED, 0)


def test_enable_and_brake_delays_hold_operation_enabled_back() -> None:
    bench = Bench()
    bench.write(0x200A, 40)
    bench.write(0x2002, 60, sub=2)
    bench.control(6, 7, 15)
    assert bench.state is S.SWITCHED_ON
    assert bench.axis.next_event(bench.now) == pytest.approx(bench.now + 0.1)
    bench.wait(0.099)
    assert bench.state is S.SWITCHED_ON
    bench.wait(0.002)
    assert bench.state is S.OPERATION_ENABLED


def test_the_brake_is_applied_before_the_power_goes() -> None:
    bench = running_at(Bench())
    bench.write(0x2002, 80, sub=1)
    bench.control(7)
    bench.wait(0.55)
    assert (bench.state, bench.velocity) == (S.OPERATION_ENABLED, 0)
    bench.wait(0.04)
    assert bench.state is S.SWITCHED_ON


def test_disable_voltage_ends_the_wait_for_the_brake() -> None:
    bench = Bench()
    bench.write(0x2002, 500, sub=2)
    bench.control(6, 7, 15, 0)
    bench.wait(1.0)
    assert bench.state is S.SWITCH_ON_DISABLED


def test_nmt_stopped_ramps_with_6085h_into_fault_and_a_reset_edge_says_so() -> None:
    bench = running_at(Bench(axis=2))
    bench.axis.nmt_stopped(bench.now)
    assert bench.state is S.FAULT_REACTION_ACTIVE
    bench.wait(0.9)
    assert bench.velocity > 0
    bench.wait(0.1)
    assert (bench.state, bench.velocity, bench.heard()) == (S.FAULT, 0, [])
    bench.control(0)
    assert bench.state is S.FAULT
    bench.control(0x80)
    assert (bench.state, bench.heard()) == (S.SWITCH_ON_DISABLED, [(0, 0, 2)])


def test_nmt_stopped_leaves_a_disabled_axis_alone() -> None:
    bench = Bench()
    bench.axis.nmt_stopped(bench.now)
    assert bench.state is S.SWITCH_ON_DISABLED


def test_a_fault_reset_needs_an_edge() -> None:
    bench = running_at(Bench())
    bench.control(0x8F)
    bench.axis.short("a", bench.now)
    bench.axis.mend(bench.now)
    bench.heard()
    bench.control(0x8F)
    assert (bench.state, bench.heard()) == (S.FAULT, [])
    bench.control(0x0F, 0x8F)
    assert bench.state is S.SWITCH_ON_DISABLED


def test_a_reset_forgets_position_mode_and_state() -> None:
    bench = running_at(Bench())
    place = bench.axis.motor.place(bench.now)
    bench.parameters.set(0x6060, 0, 0)
    bench.axis.reset(bench.now)
    assert (bench.state, bench.position, bench.read(0x6061)) == (S.SWITCH_ON_DISABLED, 0, 0)
    assert bench.axis.motor.place(bench.now) == pytest.approx(place, abs=1)


def test_some_objects_can_be_written_in_switch_on_disabled_only() -> None:
    bench = Bench()
    for index in (0x2005, 0x200B, 0x200C, 0x208C):
        assert bench.axis.may_write(index, 0, 0, bench.now) is None
    bench.control(6)
    for index in (0x2005, 0x200B, 0x200C, 0x208C):
        assert bench.axis.may_write(index, 0, 0, bench.now) == 0x08000022
    assert bench.axis.may_write(0x6060, 0, 10, bench.now) == 0x06090030


def test_the_last_bits_show_motion_and_direction() -> None:
    bench = running_at(Bench(), -30_000)
    assert bench.bit(14)
    assert bench.bit(15)
    bench.write(0x60FF, 30_000)
    bench.wait(2.0)
    assert bench.bit(14)
    assert not bench.bit(15)
    bench.write(0x60FF, 0)
    bench.wait(2.0)
    assert not bench.bit(14)
