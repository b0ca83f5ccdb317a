"""Everything that can go wrong with a simulated axis, with its EMCY (manual §11.2)."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from sim_motion_bench import Bench

from drivers.cia402.power import PowerState
from drivers.sim.motion import load
from drivers.sim.motion.axis import SimulatedAxis
from drivers.sim.motion.travel import AxisSettings
from drivers.sim.motion.troubles import Bridge

S = PowerState


def running(velocity: int = 50_000, settings: AxisSettings | None = None, *, axis: int = 1) -> Bench:
    bench = Bench(settings, axis=axis)
    bench.ramp(acceleration=100_000)
    bench.enable(3)
    bench.write(0x60FF, velocity)
    bench.wait(1.0)
    return bench


Spoil = Callable[[SimulatedAxis, float], None]


@pytest.mark.parametrize(
    ("spoil", "mend", "heard", "flags"),
    [
        (lambda a, t: a.short("high", t), lambda a, t: a.mend(t), (0x2310, 0, 1), 0x10),
        (lambda a, t: a.short("b", t), lambda a, t: a.mend(t), (0x2311, 0, 1), 0x02),
        (lambda a, t: a.short("a", t), lambda a, t: a.mend(t), (0x2312, 0, 1), 0x01),
        (
            lambda a, t: a.shutdown_input(True, t),
            lambda a, t: a.shutdown_input(False, t),
            (0x5441, 0, 255),
            0x00,
        ),
        (lambda a, t: a.supply(5.0, t), lambda a, t: a.supply(24.0, t), (0xFF00, 0, 1), 0x20),
    ],
)
def test_without_a_driver_the_motor_stands_at_once_and_the_fault_stays_as_long_as_its_cause(
    spoil: Spoil, mend: Spoil, heard: tuple[int, int, int], flags: int
) -> None:
    bench = running()
    spoil(bench.axis, bench.now)
    assert (bench.state, bench.velocity) == (S.FAULT, 0)
    assert bench.emergencies[0].register & 1
    assert bench.heard() == [heard]
    assert bench.read(0x2102) == flags
    bench.control(0x80, 0)
    assert (bench.state, bench.heard()) == (S.FAULT, [])
    mend(bench.axis, bench.now)
    bench.control(0x80)
    assert bench.state is S.SWITCH_ON_DISABLED
    assert [(e.code, e.register, e.data) for e in bench.emergencies] == [(0, 0, b"\x00\x01\x00\x00\x00")]
    assert bench.read(0x2102) == 0
    bench.heard()
    spoil(bench.axis, bench.now)
    assert (bench.state, bench.heard()) == (S.FAULT, [heard])


def test_undervoltage_takes_the_voltage_bit_away() -> None:
    bench = running()
    assert bench.bit(4)
    bench.axis.supply(5.0, bench.now)
    assert not bench.bit(4)


def test_the_temperature_warns_first_and_switches_off_then() -> None:
    bench = running()
    bench.axis.temperature(130.0, bench.now)
    assert (bench.state, bench.heard(), bench.bit(7)) == (S.OPERATION_ENABLED, [(0x4310, 1, 1)], True)
    assert bench.read(0x2102) == 0x40
    bench.axis.temperature(131.0, bench.now)
    assert bench.heard() == []
    bench.axis.temperature(160.0, bench.now)
    assert (bench.state, bench.heard()) == (S.FAULT, [(0x4310, 2, 1)])
    assert bench.read(0x2102) == 0xC0
    bench.axis.temperature(40.0, bench.now)
    assert not bench.bit(7)


@pytest.mark.parametrize(("bridge", "cause", "flags"), [("a", 1, 4), ("b", 2, 8)])
def test_an_open_load_is_a_warning(bridge: Bridge, cause: int, flags: int) -> None:
    bench = running()
    bench.axis.open_load(bridge, bench.now)
    assert bench.heard() == [(0x1000, cause, 1)]
    assert (bench.velocity, bench.bit(7), bench.read(0x2102)) == (50_000, True, flags)
    bench.axis.mend(bench.now)
    bench.control(0x8F)
    assert (bench.heard(), bench.axis.error_register) == ([(0, 0, 1)], 0)


@pytest.mark.parametrize(("velocity", "cause"), [(50_000, 3), (-50_000, 4)])
def test_a_limit_switch_stops_at_once_and_can_only_be_left(velocity: int, cause: int) -> None:
    settings = AxisSettings(positive_limit=60_000, negative_limit=-60_000)
    bench = running(velocity, settings)
    bench.wait_for_events()
    assert (bench.state, bench.velocity, bench.bit(11)) == (S.FAULT, 0, True)
    assert bench.heard() == [(0xFF01, cause, 1)]
    side = 1 if velocity > 0 else -1
    assert bench.position == side * 60_000
    bench.write(0x60FF, 0)
    bench.control(0x80, 6, 7, 15)
    assert (bench.state, bench.heard()) == (S.OPERATION_ENABLED, [(0, 0, 1)])
    bench.write(0x60FF, velocity)
    assert (bench.state, bench.heard()) == (S.FAULT, [(0xFF01, cause, 1)])
    assert bench.position == side * 60_000
    bench.write(0x60FF, -velocity)
    bench.control(0x80, 6, 7, 15)
    bench.wait(0.5)
    assert bench.state is S.OPERATION_ENABLED
    assert not bench.bit(11)


def test_a_limit_switch_pressed_by_hand_counts_while_enabled_only() -> None:
    bench = Bench(axis=2)
    bench.axis.press_switch("negative", bench.now)
    assert (bench.read(0x60FD), bench.heard()) == (1, [])
    bench.axis.release_switch("negative", bench.now)
    bench.enable(1)
    bench.axis.press_switch("negative", bench.now)
    assert (bench.state, bench.heard()) == (S.FAULT, [(0xFF01, 4, 2)])


def test_limit_switches_that_are_disabled_let_the_motor_run_into_the_end_stop() -> None:
    bench = Bench(AxisSettings(positive_limit=60_000, travel_max=70_000))
    bench.write(0x2005, 3)
    bench.ramp(acceleration=100_000)
    bench.enable(1)
    bench.move(100_000)
    bench.wait_for_events()
    assert (bench.position, bench.axis.motor.place(bench.now), bench.heard()) == (100_000, 70_000, [])
    bench.move(90_000)
    bench.wait_for_events()
    assert bench.axis.motor.place(bench.now) == 60_000


@pytest.mark.parametrize(("velocity", "cause"), [(50_000, 1), (-50_000, 2)])
def test_beyond_a_software_limit_the_motor_ramps_into_fault_and_may_come_back(
    velocity: int, cause: int
) -> None:
    bench = running(velocity)
    bench.write(0x607D, -60_000, sub=1)
    bench.write(0x607D, 60_000, sub=2)
    bench.wait_for_events()
    assert (bench.state, bench.heard()) == (S.FAULT, [(0xFF01, cause, 1)])
    side = 1 if velocity > 0 else -1
    assert bench.position * side == pytest.approx(60_000 + 50_000**2 / (2 * 51_200), abs=2)
    bench.write(0x60FF, -velocity)
    bench.control(0x80, 6, 7, 15)
    bench.wait(2.0)
    assert (bench.state, bench.velocity) == (S.OPERATION_ENABLED, -velocity)
    assert abs(bench.position) < 60_000


def test_an_encoder_counts_in_its_own_steps() -> None:
    bench = Bench()
    bench.write(0x608F, 400, sub=1)
    bench.write(0x606A, 0)
    bench.ramp()
    bench.enable(1)
    bench.move(10_000)
    bench.wait_for_events()
    assert bench.demand == 10_000
    assert bench.position == 78 * 128
    assert bench.read(0x6063) == bench.position


def test_a_blocked_axis_goes_on_in_the_counter_and_stands_on_the_encoder_until_the_following_error() -> None:
    bench = Bench(axis=1)
    bench.write(0x608F, 51_200, sub=1)
    bench.write(0x606A, 0)
    bench.write(0x6065, 1000)
    bench.ramp()
    bench.enable(1)
    bench.move(500_000)
    bench.wait(1.0)
    bench.axis.block(bench.now)
    here, velocity = bench.position, bench.velocity
    assert velocity == 0
    bench.wait(0.01)
    assert (bench.position, bench.demand) == (here, pytest.approx(here + 500, abs=1))
    assert bench.heard() == []
    bench.wait(0.02)
    assert (bench.state, bench.heard()) == (S.FAULT_REACTION_ACTIVE, [(0x8611, 0, 1)])
    bench.wait_for_events()
    assert (bench.state, bench.position) == (S.FAULT, here)
    bench.axis.unblock(bench.now)
    bench.control(0x80, 6, 7, 15)
    assert (bench.state, bench.demand) == (S.OPERATION_ENABLED, here)
    bench.move(0)
    bench.wait_for_events()
    assert (bench.position, bench.axis.motor.place(bench.now)) == (0, 0)


def test_without_an_encoder_nobody_notices_a_block_and_steps_stay_lost() -> None:
    bench = Bench()
    bench.write(0x6065, 10)
    bench.ramp()
    bench.enable(1)
    bench.axis.block(bench.now)
    bench.move(10_000)
    bench.wait_for_events()
    assert (bench.position, bench.axis.motor.place(bench.now), bench.heard()) == (10_000, 0, [])
    bench.axis.unblock(bench.now)
    bench.move(15_000)
    bench.wait_for_events()
    assert bench.axis.motor.place(bench.now) == 5000


def test_an_encoder_that_counts_backwards_is_a_following_error() -> None:
    bench = Bench(AxisSettings(encoder_reversed=True))
    bench.write(0x608F, 51_200, sub=1)
    bench.write(0x606A, 0)
    bench.write(0x6065, 500)
    bench.ramp()
    bench.enable(8)
    bench.write(0x607A, 200)
    bench.wait(0.1)
    assert (bench.position, bench.heard()) == (-200, [])
    bench.write(0x607A, 300)
    bench.wait(0.1)
    assert bench.heard() == [(0x8611, 0, 0)]
    assert bench.bit(13)


def test_selecting_the_encoder_takes_its_position_over() -> None:
    bench = Bench()
    bench.write(0x608F, 51_200, sub=1)
    bench.ramp()
    bench.enable(1)
    bench.axis.block(bench.now)
    bench.move(700)
    bench.wait_for_events()
    bench.write(0x606A, 0)
    assert (bench.demand, bench.position) == (0, 0)


def test_a_stall_is_a_fault_or_just_a_stop() -> None:
    for option, state, heard in ((0, S.FAULT, [(0x3230, 0, 1)]), (1, S.OPERATION_ENABLED, [])):
        bench = running()
        bench.write(0x20A4, 10_000)
        bench.write(0x20A7, option)
        assert 0 < bench.read(0x2101) < 1023
        bench.axis.block(bench.now)
        assert (bench.state, bench.velocity, bench.heard()) == (state, 0, heard)
        bench.wait(5.0)
        assert bench.velocity == 0


def test_below_the_threshold_speed_and_with_none_no_stall_stops_the_motor() -> None:
    for threshold in (0, 60_000):
        bench = running()
        bench.write(0x20A4, threshold)
        bench.axis.block(bench.now)
        bench.wait(1.0)
        assert (bench.velocity, bench.read(0x2101), bench.heard()) == (50_000, 0, [])


def test_a_stall_comes_when_the_speed_passes_the_threshold() -> None:
    bench = Bench()
    bench.write(0x20A4, 20_000)
    bench.ramp(acceleration=100_000)
    bench.enable(3)
    bench.axis.block(bench.now)
    bench.write(0x60FF, 50_000)
    assert bench.axis.next_event(bench.now) == pytest.approx(bench.now + 0.2)
    bench.wait(0.201)
    assert (bench.state, bench.heard()) == (S.FAULT, [(0x3230, 0, 0)])


def test_stall_guard_4_stops_below_its_threshold_while_the_chopper_is_quiet() -> None:
    bench = running()
    bench.write(0x20B0, 60_000)
    bench.write(0x20A8, 200)
    bench.write(0x20A4, 10_000)
    assert bench.read(0x210A) > 200
    bench.axis.load_torque(0.5, bench.now)
    assert (bench.state, bench.heard()) == (S.FAULT, [(0x3230, 0, 1)])


def test_more_load_than_torque_holds_the_carriage() -> None:
    bench = running()
    place = bench.axis.motor.place(bench.now)
    bench.axis.load_torque(1.2, bench.now)
    bench.wait(1.0)
    assert bench.axis.motor.place(bench.now) == pytest.approx(place, abs=1)
    bench.axis.load_torque(0.2, bench.now)
    bench.wait(1.0)
    assert bench.axis.motor.place(bench.now) == pytest.approx(place + 50_000, abs=2)
    with pytest.raises(ValueError, match="drives"):
        bench.axis.load_torque(-0.1, bench.now)


def test_the_load_value_falls_with_the_load_and_rises_with_the_speed() -> None:
    values = [load.stallguard2(share / 10, 50_000, 0) for share in range(11)]
    assert values == sorted(values, reverse=True)
    assert values[-1] == 0
    assert load.stallguard2(0.2, 20_000, 0) < load.stallguard2(0.2, 80_000, 0)
    assert load.stallguard2(0.2, 20_000, 5) > load.stallguard2(0.2, 20_000, 0)
    assert load.stallguard2(0.0, 0, 10) == 0


def test_a_stall_by_hand_is_a_stall() -> None:
    bench = running()
    bench.axis.stall(bench.now)
    assert (bench.state, bench.heard()) == (S.FAULT, [(0x3230, 0, 1)])


def test_troubles_that_are_still_there_are_reported_after_a_reset() -> None:
    bench = Bench()
    bench.axis.supply(3.0, bench.now)
    bench.heard()
    bench.axis.reset(bench.now)
    assert (bench.state, bench.heard()) == (S.FAULT, [(0xFF00, 0, 0)])


def test_a_fault_during_homing_ends_it_without_an_outcome() -> None:
    bench = Bench()
    bench.write(0x6098, 17)
    bench.write(0x6099, 50_000, sub=1)
    bench.write(0x6099, 5000, sub=2)
    bench.write(0x609A, 100_000)
    bench.enable(6)
    bench.control(31)
    bench.wait(1.0)
    bench.axis.short("a", bench.now)
    assert (bench.state, bench.bit(10), bench.bit(12)) == (S.FAULT, False, False)
