"""NMT, heartbeat, EMCY and SYNC: their frames, and the watch over a producer."""

from __future__ import annotations

import pytest

from drivers.cia301 import heartbeat, nmt, sync
from drivers.cia301.emcy import Emergency
from drivers.cia301.heartbeat import ConsumerEntry, HeartbeatMonitor
from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.sync import Sync


@pytest.mark.parametrize(
    ("command", "node", "wire"),
    [
        (NmtCommand.START, 1, "01 01"),
        (NmtCommand.STOP, 3, "02 03"),
        (NmtCommand.ENTER_PRE_OPERATIONAL, 0, "80 00"),
        (NmtCommand.RESET_NODE, 127, "81 7F"),
        (NmtCommand.RESET_COMMUNICATION, 1, "82 01"),
    ],
)
def test_nmt_commands_have_these_bytes(command: NmtCommand, node: int, wire: str) -> None:
    assert nmt.encode(command, node) == bytes.fromhex(wire)
    assert nmt.decode(bytes.fromhex(wire)) == (command, node)


@pytest.mark.parametrize("wire", ["", "01", "03 01", "01 80", "01 01 00"])
def test_what_is_no_nmt_command_is_none(wire: str) -> None:
    assert nmt.decode(bytes.fromhex(wire)) is None


def test_nmt_refuses_a_node_id_out_of_range() -> None:
    for node in (-1, 128):
        with pytest.raises(ValueError, match="node-ID"):
            nmt.encode(NmtCommand.START, node)


@pytest.mark.parametrize(
    ("state", "wire"),
    [
        (NmtState.BOOT_UP, "00"),
        (NmtState.STOPPED, "04"),
        (NmtState.OPERATIONAL, "05"),
        (NmtState.PRE_OPERATIONAL, "7F"),
    ],
)
def test_heartbeats_have_these_bytes(state: NmtState, wire: str) -> None:
    assert heartbeat.encode(state) == bytes.fromhex(wire)
    assert heartbeat.decode(bytes.fromhex(wire)) is state


@pytest.mark.parametrize("wire", ["", "85", "01", "05 00", "FF"])
def test_what_is_no_heartbeat_is_none(wire: str) -> None:
    assert heartbeat.decode(bytes.fromhex(wire)) is None


def test_the_watch_begins_with_the_first_heartbeat() -> None:
    monitor = HeartbeatMonitor(0.5)
    assert not monitor.armed
    assert not monitor.expired(1e9)
    assert monitor.deadline is None
    assert monitor.age(1.0) is None
    monitor.heard(10.0)
    assert monitor.armed
    assert monitor.deadline == 10.5
    assert monitor.age(10.25) == 0.25


def test_the_watch_expires_after_its_time_and_not_before() -> None:
    monitor = HeartbeatMonitor(0.5)
    monitor.heard(10.0)
    assert not monitor.expired(10.4999)
    assert monitor.expired(10.5)
    assert monitor.expired(99.0)
    monitor.heard(99.0)
    assert not monitor.expired(99.25)
    monitor.disarm()
    assert not monitor.expired(1e9)


@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan")])
def test_a_watch_without_a_time_is_refused(timeout: float) -> None:
    with pytest.raises(ValueError, match="time-out"):
        HeartbeatMonitor(timeout)


def test_a_consumer_entry_is_the_node_above_the_milliseconds() -> None:
    assert heartbeat.consumer_entry(127, 500) == 0x007F01F4
    assert heartbeat.decode_consumer_entry(0x007F01F4) == ConsumerEntry(127, 500)
    assert heartbeat.decode_consumer_entry(0xFF000000) == ConsumerEntry(0, 0)


@pytest.mark.parametrize(("node", "time_ms"), [(0, 1), (128, 1), (1, -1), (1, 65536)])
def test_a_consumer_entry_out_of_range_is_refused(node: int, time_ms: int) -> None:
    with pytest.raises(ValueError, match="is not in"):
        heartbeat.consumer_entry(node, time_ms)


@pytest.mark.parametrize(
    ("emergency", "wire"),
    [
        (Emergency(0x8130, 0x11, bytes.fromhex("00FF000000")), "30 81 11 00 FF 00 00 00"),
        (Emergency(0xFF01, 0x81, bytes.fromhex("0302000000")), "01 FF 81 03 02 00 00 00"),
        (Emergency(0x0000, 0x00), "00 00 00 00 00 00 00 00"),
    ],
)
def test_emergencies_have_these_bytes(emergency: Emergency, wire: str) -> None:
    assert emergency.encode() == bytes.fromhex(wire)
    assert Emergency.decode(bytes.fromhex(wire)) == emergency
    assert emergency.is_reset == (emergency.code == 0)


@pytest.mark.parametrize("wire", ["", "00 00", "30 81 11 00 FF 00 00", "30 81 11 00 FF 00 00 00 00"])
def test_what_is_no_emergency_is_none(wire: str) -> None:
    assert Emergency.decode(bytes.fromhex(wire)) is None


def test_an_emergency_that_fits_no_frame_is_refused() -> None:
    for code, register, data in ((0x10000, 0, bytes(5)), (0, 256, bytes(5)), (0, 0, bytes(4))):
        with pytest.raises(ValueError, match="does not fit"):
            Emergency(code, register, data)


def test_sync_is_empty_or_a_counter() -> None:
    assert sync.encode() == b""
    assert sync.encode(240) == b"\xf0"
    assert sync.decode(b"") == Sync(None)
    assert sync.decode(b"\x01") == Sync(1)
    assert [sync.decode(data) for data in (b"\x00", b"\xf1", b"\x01\x02")] == [None, None, None]
    for counter in (0, 241):
        with pytest.raises(ValueError, match="counter"):
            sync.encode(counter)
