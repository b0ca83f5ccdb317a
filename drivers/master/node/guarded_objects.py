"""Which objects a raw write must not touch lightly: what the safety of motion, or the service itself, rests
on.
"""

from __future__ import annotations

import enum

from drivers.devices.profile import AxisLayout


class Guard(enum.Enum):
    """How a raw write of an object is looked at."""

    FREE = enum.auto()
    CONFIRM = enum.auto()
    """Only with a confirmation, and while every axis of the node is switched off."""
    NEVER = enum.auto()
    """Only the axis's own commands, or nobody, may."""


_CONFIRM = (
    range(0x1010, 0x1012),  # store, restore
    range(0x1014, 0x1015),  # COB-ID EMCY
    range(0x1016, 0x1018),  # heartbeats both ways
    range(0x1029, 0x102A),  # error behaviour
    range(0x1400, 0x1C00),  # PDO parameters
    range(0x2003, 0x2004),  # maximum current
    range(0x2005, 0x2006),  # limit switches
    range(0x200C, 0x200D),  # brake current
    range(0x20A1, 0x20A4),  # short protection, current scaler and range
    range(0x2703, 0x2707),  # outputs, bit rate, node ID, store
    range(0x2711, 0x2712),  # I/O mode
    range(0x5FFF, 0x6000),  # bootloader entry of the vendor's modules
    range(0x605A, 0x605B),  # quick stop option
    range(0x605E, 0x605F),  # fault reaction option
    range(0x6065, 0x6066),  # following error window
    range(0x607D, 0x607E),  # software limits
)
_NEVER = (
    range(0x6040, 0x6041),  # controlword
    range(0x6060, 0x6061),  # mode
)


def guard_of(index: int, layout: AxisLayout) -> Guard:
    """How a raw write of the object at a real index is looked at, whichever axis it belongs to."""
    base, _ = layout.locate(index)
    if any(base in span for span in _NEVER):
        return Guard.NEVER
    if any(base in span for span in _CONFIRM):
        return Guard.CONFIRM
    return Guard.FREE
