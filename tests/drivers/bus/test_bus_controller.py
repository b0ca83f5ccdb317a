from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.base import BusState
from drivers.bus.controller import reported_state
from drivers.bus.frame import Frame


@pytest.mark.parametrize(
    ("error_class", "data", "state"),
    [
        (0x040, bytes(8), BusState.BUS_OFF),
        (0x044, bytes([0, 0x20]), BusState.BUS_OFF),  # bus-off counts before all
        (0x100, bytes(8), BusState.ACTIVE),
        (0x004, bytes([0, 0x04]), BusState.WARNING),
        (0x004, bytes([0, 0x08]), BusState.WARNING),
        (0x004, bytes([0, 0x10]), BusState.PASSIVE),
        (0x004, bytes([0, 0x20]), BusState.PASSIVE),
        (0x004, bytes([0, 0x28]), BusState.PASSIVE),
        (0x204, bytes([0, 0x40, 0, 0, 0, 0, 96, 0]), BusState.ACTIVE),
    ],
)
def test_each_report_becomes_a_state(error_class: int, data: bytes, state: BusState) -> None:
    report = reported_state(Frame(error_class, data, error=True))
    assert report is not None
    assert report[0] is state
    assert report[1]


@pytest.mark.parametrize(
    ("error_class", "data"),
    [
        (0x004, bytes([0, 0x01])),  # receive buffer overflow: nothing about the state
        (0x004, b"\x00"),  # socketcand gives one byte only
        (0x020, bytes(8)),  # no acknowledge
        (0x088, bytes(8)),  # bus error, protocol violation
    ],
)
def test_other_errors_leave_the_state_alone(error_class: int, data: bytes) -> None:
    assert reported_state(Frame(error_class, data, error=True)) is None


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
def test_no_error_frame_raises(error_class: int, data: bytes) -> None:
    report = reported_state(Frame(error_class, data, error=True))
    assert report is None or isinstance(report[0], BusState)
