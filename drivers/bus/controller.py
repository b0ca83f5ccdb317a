"""What an error frame of a CAN controller says about its state (Linux: include/uapi/linux/can/error.h)."""

from __future__ import annotations

from drivers.bus.base import BusState
from drivers.bus.frame import Frame

# Classes of error, in the identifier.
_CONTROLLER = 0x004
_BUS_OFF = 0x040
_RESTARTED = 0x100

# Flags of the class _CONTROLLER, in data byte 1.
_WARNING = 0x04 | 0x08
_PASSIVE = 0x10 | 0x20
_ACTIVE = 0x40


def reported_state(frame: Frame) -> tuple[BusState, str] | None:
    """The state that an error frame reports, with a sentence; None if it says nothing about the state.

    One frame can carry several classes: bus-off counts before all, and passive before warning.
    """
    if frame.cob_id & _BUS_OFF:
        return (
            BusState.BUS_OFF,
            "the CAN controller took itself off the bus (bus-off): check cable, termination and bit rate; "
            "it comes back by itself only if its restart-ms is set",
        )
    flags = frame.data[1] if frame.cob_id & _CONTROLLER and len(frame.data) > 1 else 0
    if flags & _PASSIVE:
        return (
            BusState.PASSIVE,
            "the CAN controller is error passive: nobody acknowledges, or the wire is disturbed",
        )
    if flags & _WARNING:
        return BusState.WARNING, "the CAN controller counted many errors: the wire is disturbed"
    if frame.cob_id & _RESTARTED:
        return BusState.ACTIVE, "the CAN controller was restarted after bus-off"
    if flags & _ACTIVE:
        return BusState.ACTIVE, "the CAN controller is error active again"
    return None
