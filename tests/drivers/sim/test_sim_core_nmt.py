"""NMT, heartbeats, error behavior."""

from __future__ import annotations

import pytest
from sim_core_kit import Bench, axis_fault, shown

from drivers.bus.frame import Frame
from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.sim.guarding import ErrorBehavior
from drivers.sim.motion.travel import AxisSettings


def watch(bench: Bench, behavior: int = 0, time_ms: int = 300) -> None:
    """Have the module watch node 127 and hear it once."""
    bench.write(0x1029, 1, behavior, "B")
    bench.write(0x1016, 1, 0x7F0000 | time_ms)
    assert bench.send(0x77F, "05") == []


def test_it_boots_into_pre_operational() -> None:
    bench = Bench(9)
    assert shown(bench.boot) == ["709#00"]
    assert bench.module.nmt_state is NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize(
    ("frame", "state"),
    [
        ("01 00", NmtState.OPERATIONAL),
        ("01 01", NmtState.OPERATIONAL),
        ("01 02", NmtState.PRE_OPERATIONAL),
        ("02 01", NmtState.STOPPED),
        ("80 01", NmtState.PRE_OPERATIONAL),
        ("03 01", NmtState.PRE_OPERATIONAL),
        ("01", NmtState.PRE_OPERATIONAL),
    ],
)
def test_nmt_commands(frame: str, state: NmtState) -> None:
    bench = Bench()
    bench.send(0, frame)
    assert bench.module.nmt_state is state


def test_stopped_reaches_every_axis_once() -> None:
    bench = Bench()
    bench.start()
    bench.nmt(NmtCommand.STOP)
    bench.nmt(NmtCommand.STOP)
    assert [axis.log.count(("nmt_stopped", 0.0)) for axis in bench.axes] == [1, 1, 1]


def test_reset_node_takes_everything_back_and_boots_again() -> None:
    bench = Bench()
    bench.write(0x1017, 0, 100, "H")
    bench.write(0x6081, 0, 1000)
    bench.start()
    bench.now = 0.05
    assert bench.nmt(NmtCommand.RESET_NODE, 1) == ["701#00"]
    assert bench.module.nmt_state is NmtState.PRE_OPERATIONAL
    assert (bench.read(0x1017, form="H"), bench.read(0x6081)) == (0, 0)
    assert ("reset", 0.05) in bench.axes[2].log


def test_reset_communication_takes_back_the_communication_area_only() -> None:
    bench = Bench()
    bench.write(0x1017, 0, 100, "H")
    bench.write(0x6081, 0, 1000)
    assert bench.nmt(NmtCommand.RESET_COMMUNICATION) == ["701#00"]
    assert (bench.read(0x1017, form="H"), bench.read(0x6081)) == (0, 1000)
    assert [entry for entry in bench.axes[0].log if entry[0] == "reset"] == [("reset", 0.0)]


def test_the_heartbeat_begins_at_once_and_tells_the_state() -> None:
    bench = Bench()
    assert bench.send(0x601, "2b 17 10 00 64 00 00 00") == ["581#60 17 10 00 00 00 00 00", "701#7f"]
    assert bench.later(0.25) == ["701#7f"] * 2
    bench.nmt(NmtCommand.STOP)
    assert bench.later(0.1) == ["701#04"]
    bench.nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
    bench.write(0x1017, 0, 0, "H")
    assert bench.later(10) == []


def test_a_late_wakeup_makes_up_for_no_heartbeat() -> None:
    bench = Bench()
    bench.write(0x1017, 0, 100, "H")
    bench.now = 1.05
    assert bench.poll() == ["701#7f"]
    assert bench.module.next_wakeup(bench.now) == pytest.approx(1.15)


def test_an_idle_module_has_no_wakeup() -> None:
    bench = Bench()
    assert bench.module.next_wakeup(0.0) is None
    bench.start()
    assert bench.module.next_wakeup(0.0) is None


def test_the_watch_is_armed_by_the_first_heartbeat_only() -> None:
    bench = Bench()
    bench.write(0x1016, 1, 0x7F012C)
    assert bench.module.next_wakeup(0.0) is None
    bench.send(0x77E, "05")
    assert bench.module.next_wakeup(0.0) is None
    bench.send(0x77F, "05")
    assert bench.module.next_wakeup(0.0) == pytest.approx(0.3)


def test_a_lost_heartbeat_gives_emcy_8130h_and_stops_the_module() -> None:
    bench = Bench()
    watch(bench)
    bench.start()
    assert bench.later(0.29) == []
    assert bench.later(0.02) == ["081#30 81 11 00 ff 00 00 00"]
    assert bench.module.nmt_state is NmtState.STOPPED
    assert ("nmt_stopped", pytest.approx(0.3)) in bench.axes[1].log


def test_in_pre_operational_it_only_says_so_and_says_when_it_is_back() -> None:
    bench = Bench()
    watch(bench)
    assert bench.later(1) == ["081#30 81 11 00 ff 00 00 00"]
    assert bench.module.nmt_state is NmtState.PRE_OPERATIONAL
    assert bench.read(0x1001, form="B") == 0x11
    assert bench.send(0x77F, "05") == ["081#00 00 00 00 ff 00 00 00"]
    assert bench.read(0x1001, form="B") == 0


@pytest.mark.parametrize(
    ("meaning", "value", "state"),
    [
        (ErrorBehavior.MANUAL, 0, NmtState.STOPPED),
        (ErrorBehavior.MANUAL, 1, NmtState.OPERATIONAL),
        (ErrorBehavior.MANUAL, 2, NmtState.STOPPED),
        (ErrorBehavior.MANUAL, 7, NmtState.OPERATIONAL),
        (ErrorBehavior.MANUAL_ONLY, 0, NmtState.STOPPED),
        (ErrorBehavior.CIA_301, 0, NmtState.PRE_OPERATIONAL),
        (ErrorBehavior.CIA_301, 1, NmtState.OPERATIONAL),
        (ErrorBehavior.CIA_301, 2, NmtState.STOPPED),
    ],
)
def test_error_behavior(meaning: ErrorBehavior, value: int, state: NmtState) -> None:
    bench = Bench(error_behavior=meaning)
    watch(bench, value)
    bench.start()
    bench.later(1)
    assert bench.module.nmt_state is state


def test_a_firmware_by_the_letter_of_the_manual_refuses_2() -> None:
    bench = Bench(error_behavior=ErrorBehavior.MANUAL_ONLY)
    assert bench.write(0x1029, 1, 2, "B") == 0x06090030


def test_an_axis_fault_stops_the_module_only_if_1029h_2_says_so() -> None:
    bench = Bench()
    bench.start()
    bench.axes[0].raise_emergency(axis_fault(0))
    bench.poll()
    assert bench.module.nmt_state is NmtState.OPERATIONAL
    bench.write(0x1029, 2, 0, "B")
    bench.axes[0].raise_emergency(axis_fault(0))
    assert bench.poll()[0].startswith("081#12 23")
    assert bench.module.nmt_state is NmtState.STOPPED


def test_a_module_without_supply_is_deaf_and_dumb() -> None:
    bench = Bench()
    bench.write(0x1017, 0, 100, "H")
    bench.module.power_off(0.01)
    assert bench.module.next_wakeup(0.01) is None
    assert bench.send(0x601, "40 00 10 00 00 00 00 00") == []
    assert shown(bench.module.power_on(5.0)) == ["701#00"]
    bench.now = 5.0
    assert bench.read(0x1017, form="H") == 0


def test_frames_that_are_no_data_frames_are_not_heard() -> None:
    bench = Bench()
    for frame in (
        Frame(0, b"\x01\x00", extended=True),
        Frame(0, b"\x01\x00", error=True),
        Frame(0, b"\x01\x00", remote=True),
    ):
        assert not bench.module.hears(frame)
        bench.module.on_frame(frame, 0.0)
    assert bench.module.nmt_state is NmtState.PRE_OPERATIONAL


def test_settings_for_more_axes_than_there_are_are_refused() -> None:
    with pytest.raises(ValueError, match="3 axes"):
        Bench(axes=[AxisSettings()] * 4)
