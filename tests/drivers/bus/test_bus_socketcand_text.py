"""The texts of the socketcand protocol, held against python-can's own client."""

from __future__ import annotations

import can
import pytest
from can.interfaces.socketcand import socketcand as client
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.frame import Frame
from drivers.sim.socketcand import format_frame, parse_send

data = st.binary(max_size=8)
standard = st.tuples(st.integers(0, 0x7FF), data).map(lambda drawn: Frame(*drawn))
extended = st.tuples(st.integers(0, 0x1FFFFFFF), data).map(lambda drawn: Frame(*drawn, extended=True))


@given(standard | extended)
def test_what_python_can_sends_is_read_as_it_was_meant(frame: Frame) -> None:
    message = can.Message(arbitration_id=frame.cob_id, is_extended_id=frame.extended, data=frame.data)
    text = client.convert_can_message_to_ascii_message(message)
    assert parse_send(text.strip("<>").strip()) == frame


@given(standard | extended)
def test_what_is_written_python_can_reads_as_it_was_meant(frame: Frame) -> None:
    message = client.convert_ascii_message_to_can_message(format_frame(frame, 1700000000.25))
    assert message.arbitration_id == frame.cob_id
    assert message.is_extended_id == frame.extended
    assert bytes(message.data) == frame.data
    assert message.timestamp == 1700000000.25


def test_golden_texts() -> None:
    assert format_frame(Frame(0x080), 12.5) == "< frame 080 12.500000  >"
    assert format_frame(Frame(0x701, b"\x05"), 12.5) == "< frame 701 12.500000 05 >"
    long = Frame(0x1AAAAAAA, b"\x01\xf1", extended=True)
    assert format_frame(long, 0) == "< frame 1AAAAAAA 0.000000 01F1 >"
    assert format_frame(Frame(0x701, remote=True), 0) == "< rtr 701 0.000000 0 >"
    assert format_frame(Frame(0x040, bytes(8), error=True), 0) == "< error 040 0.000000 >"
    assert parse_send("send 123 0") == Frame(0x123)
    assert parse_send("send 1AAAAAAA 2 1 F1") == long
    assert parse_send("sendrtr 123 0") == Frame(0x123, remote=True)


def test_a_remote_request_of_python_can_is_one() -> None:
    message = can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True, dlc=1)
    text = client.convert_can_message_to_ascii_message(message)
    assert parse_send(text.strip("<>").strip()) == Frame(0x701, remote=True)


@pytest.mark.parametrize(
    "command",
    [
        "send",
        "send 123",
        "send 800 0",
        "send 1234 0",
        "send FFFFFFFF 0",
        "send 123 9 1 2 3 4 5 6 7 8 9",
        "send 123 2 1",
        "send 123 1 100",
        "send 123 1 -1",
        "send 123 1 0x",
        "send 0x1 0",
        "sendrtr 123",
    ],
)
def test_a_malformed_send_is_no_frame(command: str) -> None:
    assert parse_send(command) is None


@given(st.text(max_size=60))
def test_no_text_raises(text: str) -> None:
    frame = parse_send(f"send {text}")
    assert frame is None or frame.is_sendable
