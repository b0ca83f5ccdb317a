"""One CAN frame, as everything above the wire sees it."""

from __future__ import annotations

from typing import NamedTuple


class Frame(NamedTuple):
    """A classical CAN 2.0 frame.

    A tuple rather than a dataclass, because one is made for every frame of a full bus.
    """

    cob_id: int
    """Identifier: 0..7FFh, or 0..1FFFFFFFh where `extended`."""

    data: bytes = b""
    """0 to 8 bytes."""

    timestamp: float = 0.0
    """Seconds on the monotonic clock at which the reader took the frame; 0.0 on a frame to send."""

    remote: bool = False
    """A remote transmission request: no data, and its length code is lost. CANopen here never sends one."""

    extended: bool = False
    """A 29-bit identifier. CANopen here never sends one."""

    error: bool = False
    """An error frame of the controller: its identifier is a set of flags, never a COB-ID. Test this first."""

    @property
    def is_sendable(self) -> bool:
        """Whether a controller can send it: an identifier in range, at most eight bytes, no error frame."""
        limit = 0x1FFFFFFF if self.extended else 0x7FF
        return not self.error and 0 <= self.cob_id <= limit and len(self.data) <= 8

    def __str__(self) -> str:
        kind = "ERR " if self.error else "RTR " if self.remote else ""
        return f"{kind}{self.cob_id:03X}#{self.data.hex(' ').upper()}"
