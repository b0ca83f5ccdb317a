"""The server's side of SDO: requests in, responses out; one transfer at a time, a new one ends the old."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from drivers.cia301.objects import Address
from drivers.cia301.sdo_codes import (
    DEFAULT_MAX_SIZE,
    EXPEDITED_LENGTH,
    FRAME_LENGTH,
    SEGMENT_LENGTH,
    TOGGLE,
    AbortCode,
    SdoAbort,
    abort_frame,
    address_in,
    initiate_frame,
    multiplexer,
    segment_data,
    segment_frame,
)

Read: TypeAlias = Callable[[Address], bytes]
Write: TypeAlias = Callable[[Address, bytes], None]
SizeOf: TypeAlias = Callable[[Address], int | None]

# Client command specifiers, the top three bits of byte 0. 5 and 6 are block transfer, which is not supported.
_DOWNLOAD_SEGMENT: Final = 0
_DOWNLOAD_INITIATE: Final = 1
_UPLOAD_INITIATE: Final = 2
_UPLOAD_SEGMENT: Final = 3
_ABORT: Final = 4


@dataclass(slots=True)
class _Upload:
    address: Address
    rest: bytes
    toggle: int = 0


@dataclass(slots=True)
class _Download:
    address: Address
    size: int | None
    received: bytearray = field(default_factory=bytearray)
    toggle: int = 0


def _no_size(_: Address) -> int | None:
    return None


class SdoServer:
    """Answers the frames of one client.

    `read` and `write` raise SdoAbort to refuse. `write` gets the whole data of an object, once, when the
    last of it has come. `size_of` gives the length in bytes of an object of fixed length: an expedited
    download that does not say its size is cut to it, and is taken as four bytes where it gives None.
    """

    def __init__(
        self,
        read: Read,
        write: Write,
        size_of: SizeOf = _no_size,
        max_size: int = DEFAULT_MAX_SIZE,
    ) -> None:
        self._read = read
        self._write = write
        self._size_of = size_of
        self._max_size = max_size
        self._transfer: _Upload | _Download | None = None
        self._handlers: Final = {
            _DOWNLOAD_SEGMENT: self._on_download_segment,
            _DOWNLOAD_INITIATE: self._on_download_initiate,
            _UPLOAD_INITIATE: self._on_upload_initiate,
            _UPLOAD_SEGMENT: self._on_upload_segment,
        }

    @property
    def busy(self) -> bool:
        """Whether a segmented transfer is under way."""
        return self._transfer is not None

    def reset(self) -> None:
        """Forget the transfer, as a reset of the communication does."""
        self._transfer = None

    def feed(self, data: bytes) -> bytes | None:
        """The response to one request; None where there is none to give (an abort, not eight bytes).

        Raises nothing but what `read`, `write` and `size_of` raise besides SdoAbort.
        """
        if len(data) != FRAME_LENGTH:
            return None
        command = data[0] >> 5
        if command == _ABORT:
            self._transfer = None
            return None
        handler = self._handlers.get(command)
        try:
            if handler is None:
                raise SdoAbort(AbortCode.UNKNOWN_COMMAND)
            return handler(data)
        except SdoAbort as refusal:
            address = self._address_of(command, data)
            self._transfer = None
            return abort_frame(address, refusal.code)

    def _address_of(self, command: int, data: bytes) -> Address:
        """Whose abort it is: a segment names no object, so that is the transfer's, or 0000h:0 without one."""
        if command in (_DOWNLOAD_SEGMENT, _UPLOAD_SEGMENT):
            return self._transfer.address if self._transfer else Address(0)
        return address_in(data)

    def _on_upload_initiate(self, data: bytes) -> bytes:
        self._transfer = None
        address = address_in(data)
        value = self._read(address)
        if not 1 <= len(value) <= EXPEDITED_LENGTH:
            self._transfer = _Upload(address, value)
        return initiate_frame(0x40, address, value)

    def _on_upload_segment(self, data: bytes) -> bytes:
        transfer = self._transfer
        if not isinstance(transfer, _Upload):
            raise SdoAbort(AbortCode.UNKNOWN_COMMAND)
        toggle = _checked_toggle(transfer, data)
        chunk, transfer.rest = transfer.rest[:SEGMENT_LENGTH], transfer.rest[SEGMENT_LENGTH:]
        if not transfer.rest:
            self._transfer = None
        return segment_frame(toggle, chunk, last=not transfer.rest)

    def _on_download_initiate(self, data: bytes) -> bytes:
        self._transfer = None
        address = address_in(data)
        expedited, sized = data[0] & 0x02, data[0] & 0x01
        if expedited:
            self._write(address, self._expedited_payload(address, data, sized=bool(sized)))
        else:
            size = int.from_bytes(data[4:], "little") if sized else None
            if size is not None and size > self._max_size:
                raise SdoAbort(AbortCode.OUT_OF_MEMORY)
            self._transfer = _Download(address, size)
        return b"\x60" + multiplexer(address) + bytes(4)

    def _expedited_payload(self, address: Address, data: bytes, *, sized: bool) -> bytes:
        if sized:
            return bytes(data[4 : FRAME_LENGTH - (data[0] >> 2 & 0x03)])
        size = self._size_of(address)
        return bytes(data[4:] if size is None else data[4 : 4 + size])

    def _on_download_segment(self, data: bytes) -> bytes:
        transfer = self._transfer
        if not isinstance(transfer, _Download):
            raise SdoAbort(AbortCode.UNKNOWN_COMMAND)
        toggle = _checked_toggle(transfer, data)
        transfer.received += segment_data(data)
        if len(transfer.received) > self._max_size:
            raise SdoAbort(AbortCode.OUT_OF_MEMORY)
        if transfer.size is not None and len(transfer.received) > transfer.size:
            raise SdoAbort(AbortCode.LENGTH_TOO_HIGH)
        if data[0] & 0x01:
            if transfer.size is not None and len(transfer.received) < transfer.size:
                raise SdoAbort(AbortCode.LENGTH_TOO_LOW)
            self._write(transfer.address, bytes(transfer.received))
            self._transfer = None
        return bytes((0x20 | toggle,)) + bytes(7)


def _checked_toggle(transfer: _Upload | _Download, data: bytes) -> int:
    """The request's toggle, if it is the awaited one; the next one is then awaited."""
    toggle = data[0] & TOGGLE
    if toggle != transfer.toggle:
        raise SdoAbort(AbortCode.TOGGLE_NOT_ALTERNATED)
    transfer.toggle ^= TOGGLE
    return toggle
