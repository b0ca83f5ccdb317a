from __future__ import annotations

import pytest

from drivers.bus.base import BusState
from drivers.bus.frame import Frame


@pytest.mark.parametrize(
    ("frame", "sendable"),
    [
        (Frame(0x7FF, bytes(8)), True),
        (Frame(0), True),
        (Frame(0x800), False),
        (Frame(-1), False),
        (Frame(0x800, extended=True), True),
        (Frame(0x20000000, extended=True), False),
        (Frame(0x181, bytes(9)), False),
        (Frame(0x040, bytes(8), error=True), False),
    ],
)
def test_only_what_a_controller_can_send_is_sendable(frame: Frame, sendable: bool) -> None:
    assert frame.is_sendable is sendable


def test_a_frame_reads_as_in_the_manuals() -> None:
    assert str(Frame(0x601, bytes([0x40, 0x41, 0x60]))) == "601#40 41 60"
    assert str(Frame(0x701, remote=True)) == "RTR 701#"
    assert str(Frame(0x040, error=True)) == "ERR 040#"


def test_only_the_error_counting_states_can_send() -> None:
    can_send = {state for state in BusState if state.can_send}
    assert can_send == {BusState.ACTIVE, BusState.WARNING, BusState.PASSIVE}
