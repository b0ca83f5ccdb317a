"""SDO abort codes in words, and the frame layouts that client and server share (CiA 301 7.2.4.3)."""

from __future__ import annotations

import enum
import struct
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from drivers.cia301.objects import Address

FRAME_LENGTH: Final = 8
SEGMENT_LENGTH: Final = 7
EXPEDITED_LENGTH: Final = 4
TOGGLE: Final = 0x10
DEFAULT_MAX_SIZE: Final = 64 * 1024
"""Bytes that one transfer may carry unless its owner says otherwise."""


class AbortCode(enum.IntEnum):
    """The abort codes of manual section 12, which are those of CiA 301 table 22."""

    TOGGLE_NOT_ALTERNATED = 0x05030000
    TIMED_OUT = 0x05040000
    UNKNOWN_COMMAND = 0x05040001
    INVALID_BLOCK_SIZE = 0x05040002
    INVALID_SEQUENCE_NUMBER = 0x05040003
    CRC_ERROR = 0x05040004
    OUT_OF_MEMORY = 0x05040005
    UNSUPPORTED_ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_SUCH_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_LENGTH_EXCEEDED = 0x06040042
    PARAMETER_INCOMPATIBLE = 0x06040043
    INTERNAL_INCOMPATIBLE = 0x06040047
    HARDWARE_ERROR = 0x06060000
    LENGTH_MISMATCH = 0x06070010
    LENGTH_TOO_HIGH = 0x06070012
    LENGTH_TOO_LOW = 0x06070013
    NO_SUCH_SUB_INDEX = 0x06090011
    INVALID_VALUE = 0x06090030
    VALUE_TOO_HIGH = 0x06090031
    VALUE_TOO_LOW = 0x06090032
    MAXIMUM_LESS_THAN_MINIMUM = 0x06090036
    RESOURCE_NOT_AVAILABLE = 0x060A0023
    GENERAL_ERROR = 0x08000000
    CANNOT_STORE = 0x08000020
    LOCAL_CONTROL = 0x08000021
    DEVICE_STATE = 0x08000022
    NO_OBJECT_DICTIONARY = 0x08000023
    NO_DATA = 0x08000024


_MEANINGS: Final[Mapping[int, str]] = MappingProxyType(
    {
        AbortCode.TOGGLE_NOT_ALTERNATED: "a segment was repeated or lost (the toggle bit did not change)",
        AbortCode.TIMED_OUT: "the other side did not go on with the transfer in time",
        AbortCode.UNKNOWN_COMMAND: "the command is unknown here, or not expected now",
        AbortCode.INVALID_BLOCK_SIZE: "the block transfer has an invalid block size",
        AbortCode.INVALID_SEQUENCE_NUMBER: "the block transfer has an invalid sequence number",
        AbortCode.CRC_ERROR: "the checksum of the block transfer is wrong",
        AbortCode.OUT_OF_MEMORY: "the data is too long to be held",
        AbortCode.UNSUPPORTED_ACCESS: "the object can't be accessed like this",
        AbortCode.WRITE_ONLY: "the object can only be written, not read",
        AbortCode.READ_ONLY: "the object can only be read, not written",
        AbortCode.NO_SUCH_OBJECT: "there is no such object",
        AbortCode.NOT_MAPPABLE: "the object can't be mapped into this PDO",
        AbortCode.PDO_LENGTH_EXCEEDED: "the mapped objects are too many or too long for a PDO",
        AbortCode.PARAMETER_INCOMPATIBLE: "the value contradicts another parameter",
        AbortCode.INTERNAL_INCOMPATIBLE: "the value contradicts something inside the device",
        AbortCode.HARDWARE_ERROR: "the device's hardware failed, for instance its memory",
        AbortCode.LENGTH_MISMATCH: "the data has another length than the object's type",
        AbortCode.LENGTH_TOO_HIGH: "the data is longer than the object's type",
        AbortCode.LENGTH_TOO_LOW: "the data is shorter than the object's type",
        AbortCode.NO_SUCH_SUB_INDEX: "the object has no such sub-index",
        AbortCode.INVALID_VALUE: "the object does not take this value",
        AbortCode.VALUE_TOO_HIGH: "the value is above the object's range",
        AbortCode.VALUE_TOO_LOW: "the value is below the object's range",
        AbortCode.MAXIMUM_LESS_THAN_MINIMUM: "the maximum would be below the minimum",
        AbortCode.RESOURCE_NOT_AVAILABLE: "something that this needs is not available",
        AbortCode.GENERAL_ERROR: "the device refused without saying why",
        AbortCode.CANNOT_STORE: "the data could not be taken or stored (a wrong signature, for instance)",
        AbortCode.LOCAL_CONTROL: "the data can't be taken while the device is under local control",
        AbortCode.DEVICE_STATE: "the data can't be taken in the state that the device is in now",
        AbortCode.NO_OBJECT_DICTIONARY: "the device has no object dictionary, or could not make it",
        AbortCode.NO_DATA: "there is no data to read",
    }
)


def abort_meaning(code: int) -> str:
    """What an abort code says, as the end of a sentence. An unknown code gets a text too."""
    return _MEANINGS.get(code) or f"the device gave the unknown abort code {code:08X}h"


class SdoAbort(Exception):
    """Raised by what stands behind an `SdoServer` to refuse a transfer with this code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:08X}h: {abort_meaning(code)}")
        self.code = code


_MULTIPLEXER: Final = struct.Struct("<HB")


def multiplexer(address: Address) -> bytes:
    """Index and sub-index as bytes 1 to 3 of a frame."""
    return _MULTIPLEXER.pack(*address)


def address_in(data: bytes) -> Address:
    """Index and sub-index in bytes 1 to 3 of a frame that carries them."""
    return Address(*_MULTIPLEXER.unpack_from(data, 1))


def abort_frame(address: Address, code: int) -> bytes:
    """The abort of a transfer, the same from both sides."""
    return b"\x80" + multiplexer(address) + code.to_bytes(4, "little")


def initiate_frame(command: int, address: Address, data: bytes) -> bytes:
    """An initiate frame for `data`: expedited for 1 to 4 bytes, else its size for segments to follow."""
    if 1 <= len(data) <= EXPEDITED_LENGTH:
        flags = (EXPEDITED_LENGTH - len(data)) << 2 | 0x03
        return bytes((command | flags,)) + multiplexer(address) + data.ljust(EXPEDITED_LENGTH, b"\0")
    return bytes((command | 0x01,)) + multiplexer(address) + len(data).to_bytes(4, "little")


def segment_frame(toggle: int, chunk: bytes, *, last: bool) -> bytes:
    """A segment of 0 to 7 bytes; `toggle` is 0 or `TOGGLE`."""
    flags = toggle | (SEGMENT_LENGTH - len(chunk)) << 1 | (1 if last else 0)
    return bytes((flags,)) + chunk.ljust(SEGMENT_LENGTH, b"\0")


def segment_data(data: bytes) -> bytes:
    """The payload of a segment frame."""
    return bytes(data[1 : FRAME_LENGTH - (data[0] >> 1 & 0x07)])
