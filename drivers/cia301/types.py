"""The data types of the object dictionary, and their little-endian bytes (CiA 301 7.1, 7.4.7)."""

from __future__ import annotations

import enum
import math
import struct
from typing import Final, NamedTuple, TypeAlias

Value: TypeAlias = int | float | str | bytes | bool
"""What an object can hold. `bool` only for BOOLEAN, `bytes` only for OCTET_STRING and DOMAIN."""


class CodecError(ValueError):
    """A value does not fit its data type, or bytes are no value of it. The message says which and why."""


class DataType(enum.IntEnum):
    """A static data type; the number is its index in the object dictionary and in an EDS."""

    BOOLEAN = 0x01
    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    REAL32 = 0x08
    VISIBLE_STRING = 0x09
    OCTET_STRING = 0x0A
    UNICODE_STRING = 0x0B
    DOMAIN = 0x0F
    REAL64 = 0x11
    INTEGER64 = 0x15
    UNSIGNED64 = 0x1B

    @property
    def bits(self) -> int | None:
        """Length in bits as in a PDO mapping entry; None where the length varies. BOOLEAN counts 8 here."""
        packing = _LAYOUTS[self].packing
        return None if packing is None else packing.size * 8

    @property
    def size(self) -> int | None:
        """Length in bytes; None where it varies."""
        packing = _LAYOUTS[self].packing
        return None if packing is None else packing.size

    @property
    def is_integer(self) -> bool:
        """Whether it is one of INTEGERn and UNSIGNEDn."""
        return self.short[0] in "IU" and self.size is not None

    @property
    def signed(self) -> bool:
        """Whether it is one of INTEGERn."""
        return self.is_integer and self.short[0] == "I"

    @property
    def minimum(self) -> int:
        """Least value of an integer type, 0 for BOOLEAN. TypeError for the others."""
        return -(1 << self._width() - 1) if self.signed else 0

    @property
    def maximum(self) -> int:
        """Greatest value of an integer type, 1 for BOOLEAN. TypeError for the others."""
        if self is DataType.BOOLEAN:
            return 1
        return (1 << self._width() - (1 if self.signed else 0)) - 1

    @property
    def short(self) -> str:
        """How people abbreviate it: ``U32``, ``I8``, ``F32``, ``STR`` ..."""
        return _LAYOUTS[self].short

    def _width(self) -> int:
        bits = self.bits
        if bits is None or not (self.is_integer or self is DataType.BOOLEAN):
            raise TypeError(f"{self.name} has no integer range")
        return bits


class _Layout(NamedTuple):
    short: str
    packing: struct.Struct | None


_LAYOUTS: Final[dict[DataType, _Layout]] = {
    DataType.BOOLEAN: _Layout("BOOL", struct.Struct("<B")),
    DataType.INTEGER8: _Layout("I8", struct.Struct("<b")),
    DataType.INTEGER16: _Layout("I16", struct.Struct("<h")),
    DataType.INTEGER32: _Layout("I32", struct.Struct("<i")),
    DataType.INTEGER64: _Layout("I64", struct.Struct("<q")),
    DataType.UNSIGNED8: _Layout("U8", struct.Struct("<B")),
    DataType.UNSIGNED16: _Layout("U16", struct.Struct("<H")),
    DataType.UNSIGNED32: _Layout("U32", struct.Struct("<I")),
    DataType.UNSIGNED64: _Layout("U64", struct.Struct("<Q")),
    DataType.REAL32: _Layout("F32", struct.Struct("<f")),
    DataType.REAL64: _Layout("F64", struct.Struct("<d")),
    DataType.VISIBLE_STRING: _Layout("STR", None),
    DataType.OCTET_STRING: _Layout("BYTES", None),
    DataType.UNICODE_STRING: _Layout("USTR", None),
    DataType.DOMAIN: _Layout("DOMAIN", None),
}

_TEXT_ENCODING: Final[dict[DataType, str]] = {
    # The standard's visible string is ASCII; Latin-1 reads whatever else a device puts there.
    DataType.VISIBLE_STRING: "latin-1",
    DataType.UNICODE_STRING: "utf-16-le",
}


def encode(data_type: DataType, value: Value) -> bytes:
    """The bytes of `value` on the wire.

    Integers take `int` (never `bool`, never `float`) in the type's range, REALn a finite `float` or `int`,
    BOOLEAN a `bool`, the strings a `str` without NUL, OCTET_STRING and DOMAIN `bytes`. Anything else raises
    CodecError.
    """
    if data_type.is_integer:
        return _encode_integer(data_type, value)
    if data_type is DataType.BOOLEAN:
        if not isinstance(value, bool):
            raise _wrong_type(data_type, value, "true or false")
        return b"\x01" if value else b"\x00"
    if data_type in (DataType.REAL32, DataType.REAL64):
        return _encode_real(data_type, value)
    if data_type in _TEXT_ENCODING:
        return _encode_text(data_type, value)
    if not isinstance(value, bytes):
        raise _wrong_type(data_type, value, "bytes")
    return value


def decode(data_type: DataType, data: bytes) -> Value:
    """The value that `data` holds.

    Fixed types need exactly their length, a BOOLEAN 0 or 1, a REALn a finite number: CodecError otherwise.
    Strings are read tolerantly, and trailing NULs are dropped.
    """
    packing = _LAYOUTS[data_type].packing
    if packing is None:
        return _decode_text(data_type, data) if data_type in _TEXT_ENCODING else bytes(data)
    if len(data) != packing.size:
        raise CodecError(f"{data_type.name} has {packing.size} bytes, not {len(data)} ({data.hex(' ')})")
    (value,) = packing.unpack(data)
    if data_type is DataType.BOOLEAN:
        if value > 1:
            raise CodecError(f"a BOOLEAN is 0 or 1, not {value}")
        return bool(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise CodecError(f"{data_type.name} holds no finite number ({data.hex(' ')})")
    return value


def _wrong_type(data_type: DataType, value: object, wanted: str) -> CodecError:
    return CodecError(f"{data_type.name} takes {wanted}, not {type(value).__name__} {value!r:.40}")


def _packing(data_type: DataType) -> struct.Struct:
    packing = _LAYOUTS[data_type].packing
    assert packing is not None
    return packing


def _encode_integer(data_type: DataType, value: Value) -> bytes:
    if isinstance(value, bool) or not isinstance(value, int):
        raise _wrong_type(data_type, value, "an integer")
    if not data_type.minimum <= value <= data_type.maximum:
        raise CodecError(f"{value} is not in {data_type.name}'s {data_type.minimum}..{data_type.maximum}")
    return _packing(data_type).pack(value)


def _encode_real(data_type: DataType, value: Value) -> bytes:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong_type(data_type, value, "a number")
    try:
        if not math.isfinite(value):
            raise CodecError(f"{data_type.name} takes a finite number, not {value}")
        return _packing(data_type).pack(value)
    except (OverflowError, struct.error) as error:
        raise CodecError(f"{value!r:.40} is too large for {data_type.name}") from error


def _encode_text(data_type: DataType, value: Value) -> bytes:
    if not isinstance(value, str):
        raise _wrong_type(data_type, value, "text")
    if "\0" in value:
        raise CodecError(f"{data_type.name} takes text without NUL characters")
    try:
        return value.encode(_TEXT_ENCODING[data_type])
    except UnicodeEncodeError as error:
        raise CodecError(f"{data_type.name} can't hold {value[error.start]!a}") from error


def _decode_text(data_type: DataType, data: bytes) -> str:
    if data_type is DataType.UNICODE_STRING and len(data) % 2:
        raise CodecError(f"UNICODE_STRING has an even number of bytes, not {len(data)}")
    return data.decode(_TEXT_ENCODING[data_type], errors="replace").rstrip("\0")
