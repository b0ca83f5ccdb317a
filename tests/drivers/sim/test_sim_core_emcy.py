"""Emergencies: format, error register, 1014h, 1015h, what the CAN controller reports (manual §11)."""

from __future__ import annotations

import pytest
from sim_core_kit import Bench, axis_fault, shown

from drivers.cia301.emcy import Emergency
from drivers.cia301.nmt import NmtCommand, NmtState


def test_an_axis_emergency_carries_its_axis_and_stays_in_the_error_register() -> None:
    bench = Bench()
    bench.axes[1].raise_emergency(axis_fault(1))
    assert bench.poll() == ["081#12 23 03 00 01 00 00 00"]
    assert bench.read(0x1001, form="B") == 3


def test_the_register_is_the_union_of_what_all_axes_hold() -> None:
    bench = Bench()
    bench.axes[0].raise_emergency(axis_fault(0, 0x2312, 0x03))
    bench.axes[2].raise_emergency(axis_fault(2, 0x4310, 0x09))
    assert [frame[10:12] for frame in bench.poll()] == ["03", "0b"]
    bench.axes[0].raise_emergency(Emergency(0, 0, bytes((0, 0, 0, 0, 0))))
    assert bench.poll() == ["081#00 00 09 00 00 00 00 00"]
    assert bench.module.error_register == 9


def test_the_inhibit_time_keeps_them_apart_and_in_order() -> None:
    bench = Bench()
    bench.write(0x1015, 0, 500, "H")
    for axis in range(3):
        bench.axes[axis].raise_emergency(axis_fault(axis))
    assert [frame[16:18] for frame in bench.poll()] == ["00"]
    assert bench.later(0.049) == []
    assert [frame[16:18] for frame in bench.later(0.1)] == ["01", "02"]
    assert bench.module.next_wakeup(bench.now) is None


def test_1014h_moves_and_switches_them_off() -> None:
    bench = Bench()
    assert bench.write(0x1014, 0, 0x99) is None
    bench.axes[0].raise_emergency(axis_fault(0))
    assert bench.poll()[0].startswith("099#")
    assert bench.write(0x1014, 0, 0x80000099) is None
    bench.axes[0].raise_emergency(axis_fault(0))
    assert bench.poll() == []


def test_none_in_stopped_and_none_made_up_for() -> None:
    bench = Bench()
    bench.nmt(NmtCommand.STOP)
    bench.axes[0].raise_emergency(axis_fault(0))
    assert bench.poll() == []
    bench.nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
    assert bench.poll() == []
    assert bench.read(0x1001, form="B") == 3


def test_a_flood_is_bounded() -> None:
    bench = Bench()
    bench.write(0x1015, 0, 10, "H")
    for _ in range(1000):
        bench.axes[0].raise_emergency(axis_fault(0))
    assert len(bench.later(10)) == 32


@pytest.mark.parametrize(
    ("code", "detail", "frame"),
    [
        (0x8100, 0, "081#00 81 11 00 ff 00 00 00"),
        (0x8110, 2, "081#10 81 11 02 ff 00 00 00"),
        (0x8120, 0, "081#20 81 11 00 ff 00 00 00"),
        (0x5441, 0, "081#41 54 01 00 ff 00 00 00"),
    ],
)
def test_what_the_module_reports(code: int, detail: int, frame: str) -> None:
    bench = Bench()
    assert shown(bench.module.report(code, detail, 0.0)) == [frame]


def test_bus_off_stops_the_axes_and_is_told_afterwards() -> None:
    bench = Bench()
    bench.start()
    bench.module.bus_off(1.0)
    assert all(("nmt_stopped", 1.0) in axis.log for axis in bench.axes)
    assert shown(bench.module.bus_on(2.0)) == ["081#40 81 11 00 ff 00 00 00"]
    assert bench.module.nmt_state is NmtState.STOPPED


def test_every_module_wide_row_of_the_manual_is_known_to_the_profile() -> None:
    bench = Bench()
    for code, detail in ((0x8130, 0), (0x8140, 0), (0x8210, 0), (0x8220, 0), (0x6320, 0)):
        assert bench.module.profile.emergencies.row(code, detail) is not None
