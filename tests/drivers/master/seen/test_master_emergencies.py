"""The emergency log: explained, bounded, and active only until it is over."""

from __future__ import annotations

from drivers.cia301.emcy import Emergency
from drivers.devices.catalog import Catalog
from drivers.master.seen.emergencies import CAPACITY, EmergencyLog


def log() -> EmergencyLog:
    return EmergencyLog(1, Catalog.load().profile("TMCM-3216").emergencies)


def test_an_emergency_is_explained_and_active_on_its_axis() -> None:
    it = log()
    record = it.record(Emergency(0x2312, 0x03, bytes((0, 2, 0, 0, 0))))
    assert (record.axis, record.active) == (2, True)
    assert record.title
    assert record.remedy
    assert it.active(2) == (record,)
    assert it.active(0) == ()


def test_what_concerns_the_module_is_active_on_every_axis() -> None:
    it = log()
    it.record(Emergency(0x8130, 0x11, bytes((0, 255, 0, 0, 0))))
    assert [e.code for e in it.active(0)] == [0x8130]
    assert [e.code for e in it.active(1)] == [0x8130]


def test_a_fault_reset_clears_its_axis_only() -> None:
    it = log()
    for axis in (0, 1):
        it.record(Emergency(0x2312, 0x03, bytes((0, axis, 0, 0, 0))))
    it.record(Emergency(0, 0, bytes((0, 1, 0, 0, 0))))
    assert [e.axis for e in it.all_active()] == [0]
    assert [e.active for e in it.history] == [True, False, False]


def test_a_storm_is_bounded() -> None:
    it = log()
    for number in range(5000):
        it.record(Emergency(number % 60_000 + 1, 0, bytes((number % 256, number % 3, 0, 0, 0))))
    assert len(it.history) == CAPACITY
    assert len(it.all_active()) <= CAPACITY
    assert it.history[-1].id == 5000
