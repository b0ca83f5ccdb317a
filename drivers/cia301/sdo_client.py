"""The client's side of an SDO transfer: the server's bytes in, the next request, the end or an abort out.

No clock: whoever drives a transfer decides how long it waits, and sends `abort_frame()` when it gives up.

What is taken for an answer: an initiate answer or an abort must carry the transfer's own index and
sub-index and the command specifier that is awaited. A segment's answer carries no address, so there only
the phase and the toggle tell; after a time-out the caller must therefore keep the channel quiet until no
late segment can come any more.
"""

from __future__ import annotations

import abc
from typing import Final, NamedTuple, TypeAlias

from drivers.cia301.objects import Address
from drivers.cia301.sdo_codes import (
    DEFAULT_MAX_SIZE,
    EXPEDITED_LENGTH,
    FRAME_LENGTH,
    SEGMENT_LENGTH,
    TOGGLE,
    AbortCode,
    abort_frame,
    address_in,
    initiate_frame,
    multiplexer,
    segment_data,
    segment_frame,
)


class Send(NamedTuple):
    """Send this request next."""

    data: bytes


class Done(NamedTuple):
    """The transfer has succeeded. `data` is what an upload brought, empty for a download."""

    data: bytes = b""
    size_indicated: bool = True
    """False where an expedited answer gave no size: `data` is four bytes then, cut it by the type."""


class Aborted(NamedTuple):
    """The server refused; the transfer is over."""

    code: int


class Violation(NamedTuple):
    """The server broke the protocol: send `abort`; the transfer is over and nothing of it may be used."""

    reason: str
    abort: bytes


class Ignored(NamedTuple):
    """A frame that is not the awaited answer: late, foreign or malformed. Count it and wait on."""

    reason: str


Step: TypeAlias = Send | Done | Aborted | Violation | Ignored
_ENDS: Final = (Done, Aborted, Violation)

# Server command specifiers, the top three bits of byte 0.
_UPLOAD_SEGMENT: Final = 0
_DOWNLOAD_SEGMENT: Final = 1
_UPLOAD_INITIATE: Final = 2
_DOWNLOAD_INITIATE: Final = 3
_ABORT: Final = 4
_SEGMENTS: Final = (_UPLOAD_SEGMENT, _DOWNLOAD_SEGMENT)
_NEVER_ASKED_FOR: Final = (5, 6, 7)


class SdoTransfer(abc.ABC):
    """One transfer of one object. `feed` every frame of the server's COB-ID to it, whatever it may be."""

    _initiate: int
    _segment: int
    _segmented = False
    _finished = False
    _toggle = 0

    def __init__(self, address: Address) -> None:
        self.address = address
        self._multiplexer = multiplexer(address)

    @abc.abstractmethod
    def request(self) -> bytes:
        """The first request, eight bytes."""

    @property
    def finished(self) -> bool:
        """Whether `Done`, `Aborted` or `Violation` was given; all that is fed later is `Ignored`."""
        return self._finished

    def could_take_answer_to(self, other: SdoTransfer) -> bool:
        """Whether a late answer to `other` could pass for one to this: the object is the same, or, where the
        segments of `other` had begun, the answer says of no object.
        """
        return other._segmented or other.address == self.address

    def abort_frame(self, code: int = AbortCode.TIMED_OUT) -> bytes:
        """The frame that tells the server to forget this transfer."""
        return abort_frame(self.address, code)

    def feed(self, data: bytes) -> Step:
        """Take one frame from the server. Never raises, whatever the bytes."""
        if self._finished:
            return Ignored("the transfer is over")
        if len(data) != FRAME_LENGTH:
            return Ignored(f"an SDO frame has 8 bytes, not {len(data)}")
        command = data[0] >> 5
        step = self._feed_segment(data) if command in _SEGMENTS else self._feed_addressed(command, data)
        if isinstance(step, _ENDS):
            self._finished = True
        return step

    def _feed_addressed(self, command: int, data: bytes) -> Step:
        if data[1:4] != self._multiplexer:
            return Ignored(f"an answer about {address_in(data)} while {self.address} is awaited")
        if command == _ABORT:
            return Aborted(int.from_bytes(data[4:], "little"))
        if command in _NEVER_ASKED_FOR:
            return self._violation(
                AbortCode.UNKNOWN_COMMAND, f"byte {data[0]:02X}h answers no request of ours"
            )
        if command != self._initiate or self._segmented:
            return Ignored(f"byte {data[0]:02X}h is not the answer that {self.address} awaits now")
        return self._on_initiate(data)

    def _feed_segment(self, data: bytes) -> Step:
        if not self._segmented or data[0] >> 5 != self._segment:
            return Ignored(f"a segment's answer ({data[0]:02X}h) that nobody awaits")
        if data[0] & TOGGLE != self._toggle:
            return self._violation(AbortCode.TOGGLE_NOT_ALTERNATED, "the toggle bit did not alternate")
        self._toggle ^= TOGGLE
        return self._on_segment(data)

    def _violation(self, code: AbortCode, reason: str) -> Violation:
        return Violation(f"{self.address}: {reason}", self.abort_frame(code))

    @abc.abstractmethod
    def _on_initiate(self, data: bytes) -> Step:
        """The awaited answer to `request()`."""

    @abc.abstractmethod
    def _on_segment(self, data: bytes) -> Step:
        """The awaited answer to a segment request, its toggle already checked."""


class SdoUpload(SdoTransfer):
    """Reads an object. An answer of more than `max_size` bytes is a violation (05040005h)."""

    _initiate = _UPLOAD_INITIATE
    _segment = _UPLOAD_SEGMENT
    _size: int | None = None
    _received: bytearray

    def __init__(self, address: Address, max_size: int = DEFAULT_MAX_SIZE) -> None:
        super().__init__(address)
        self._max_size = max_size

    def request(self) -> bytes:
        """40h, index, sub."""
        return b"\x40" + self._multiplexer + b"\0\0\0\0"

    def _on_initiate(self, data: bytes) -> Step:
        expedited, sized = data[0] & 0x02, bool(data[0] & 0x01)
        if expedited:
            unused = data[0] >> 2 & 0x03 if sized else 0
            return Done(bytes(data[4 : FRAME_LENGTH - unused]), size_indicated=sized)
        if sized:
            self._size = int.from_bytes(data[4:], "little")
            if self._size > self._max_size:
                return self._too_long()
        self._segmented = True
        self._received = bytearray()
        return self._ask()

    def _on_segment(self, data: bytes) -> Step:
        chunk, last = segment_data(data), data[0] & 0x01
        self._received += chunk
        if len(self._received) > self._max_size:
            return self._too_long()
        if self._size is not None and (
            len(self._received) > self._size or (last and len(self._received) < self._size)
        ):
            reason = f"{len(self._received)} bytes came where {self._size} were announced"
            return self._violation(AbortCode.LENGTH_MISMATCH, reason)
        if last:
            return Done(bytes(self._received))
        if not chunk:
            # Else a server could keep the transfer alive for ever without passing max_size.
            return self._violation(AbortCode.LENGTH_MISMATCH, "an empty segment that is not the last")
        return self._ask()

    def _ask(self) -> Send:
        return Send(bytes((0x60 | self._toggle,)) + bytes(7))

    def _too_long(self) -> Violation:
        return self._violation(AbortCode.OUT_OF_MEMORY, f"the answer is longer than {self._max_size} bytes")


class SdoDownload(SdoTransfer):
    """Writes an object: expedited for 1 to 4 bytes, segmented else, always with the size."""

    _initiate = _DOWNLOAD_INITIATE
    _segment = _DOWNLOAD_SEGMENT

    def __init__(self, address: Address, data: bytes) -> None:
        super().__init__(address)
        self._data = bytes(data)
        self._sent = 0

    def request(self) -> bytes:
        """21h or 23h to 2Fh, index, sub, then the data or its length."""
        return initiate_frame(0x20, self.address, self._data)

    def _on_initiate(self, data: bytes) -> Step:  # noqa: ARG002
        if 1 <= len(self._data) <= EXPEDITED_LENGTH:
            return Done()
        self._segmented = True
        return self._next_segment()

    def _on_segment(self, data: bytes) -> Step:  # noqa: ARG002
        if self._sent == len(self._data):
            return Done()
        return self._next_segment()

    def _next_segment(self) -> Send:
        chunk = self._data[self._sent : self._sent + SEGMENT_LENGTH]
        self._sent += len(chunk)
        return Send(segment_frame(self._toggle, chunk, last=self._sent == len(self._data)))
