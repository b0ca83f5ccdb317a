"""Data types and their bytes."""

from __future__ import annotations

import math

import pytest

from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.types import CodecError, DataType, Value, decode, encode

GOLDEN: list[tuple[DataType, Value, str]] = [
    (DataType.BOOLEAN, True, "01"),
    (DataType.BOOLEAN, False, "00"),
    (DataType.INTEGER8, -1, "FF"),
    (DataType.INTEGER8, 6, "06"),
    (DataType.INTEGER16, -2, "FE FF"),
    (DataType.INTEGER32, 500000, "20 A1 07 00"),
    (DataType.INTEGER32, -2147483648, "00 00 00 80"),
    (DataType.INTEGER64, -1, "FF FF FF FF FF FF FF FF"),
    (DataType.UNSIGNED8, 35, "23"),
    (DataType.UNSIGNED16, 0x0637, "37 06"),
    (DataType.UNSIGNED32, 0x65766173, "73 61 76 65"),
    (DataType.UNSIGNED32, 0xFFFC0192, "92 01 FC FF"),
    (DataType.UNSIGNED64, 1, "01 00 00 00 00 00 00 00"),
    (DataType.REAL32, 1.5, "00 00 C0 3F"),
    (DataType.REAL64, -2.0, "00 00 00 00 00 00 00 C0"),
    (DataType.VISIBLE_STRING, "TMCM-3216", "54 4D 43 4D 2D 33 32 31 36"),
    (DataType.UNICODE_STRING, "hµ", "68 00 B5 00"),
    (DataType.OCTET_STRING, b"\x00\x01\x00", "00 01 00"),
    (DataType.DOMAIN, b"", ""),
]


@pytest.mark.parametrize(("data_type", "value", "wire"), GOLDEN)
def test_a_value_has_these_bytes(data_type: DataType, value: Value, wire: str) -> None:
    assert encode(data_type, value) == bytes.fromhex(wire)
    assert decode(data_type, bytes.fromhex(wire)) == value


@pytest.mark.parametrize(
    ("data_type", "value", "message"),
    [
        (DataType.UNSIGNED8, 256, "256 is not in UNSIGNED8's 0..255"),
        (DataType.UNSIGNED8, -1, "0..255"),
        (DataType.INTEGER8, 128, "-128..127"),
        (DataType.INTEGER32, 2**31, "INTEGER32"),
        (DataType.UNSIGNED8, True, "takes an integer, not bool"),
        (DataType.UNSIGNED8, 1.0, "takes an integer, not float"),
        (DataType.UNSIGNED8, "1", "takes an integer, not str"),
        (DataType.BOOLEAN, 1, "true or false"),
        (DataType.REAL32, math.nan, "finite"),
        (DataType.REAL64, math.inf, "finite"),
        (DataType.REAL32, 1e39, "too large"),
        (DataType.REAL64, 10**400, "too large"),
        (DataType.REAL32, True, "a number"),
        (DataType.VISIBLE_STRING, b"x", "text"),
        (DataType.VISIBLE_STRING, "\u20ac", "can't hold"),
        (DataType.VISIBLE_STRING, "a\0", "NUL"),
        (DataType.UNICODE_STRING, "\ud800", "can't hold"),
        (DataType.OCTET_STRING, "x", "bytes"),
        (DataType.DOMAIN, 7, "bytes"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_with_the_reason(
    data_type: DataType, value: Value, message: str
) -> None:
    with pytest.raises(CodecError, match=message.replace("(", r"\(")):
        encode(data_type, value)


@pytest.mark.parametrize(
    ("data_type", "wire", "message"),
    [
        (DataType.UNSIGNED32, "01 02", "UNSIGNED32 has 4 bytes, not 2"),
        (DataType.UNSIGNED8, "01 00 00 00", "UNSIGNED8 has 1 bytes, not 4"),
        (DataType.INTEGER16, "", "not 0"),
        (DataType.BOOLEAN, "02", "0 or 1"),
        (DataType.REAL32, "00 00 C0 7F", "no finite number"),
        (DataType.REAL64, "00 00 00 00 00 00 F0 7F", "no finite number"),
        (DataType.UNICODE_STRING, "41", "even number"),
    ],
)
def test_bytes_that_are_no_value_are_refused_with_the_reason(
    data_type: DataType, wire: str, message: str
) -> None:
    with pytest.raises(CodecError, match=message):
        decode(data_type, bytes.fromhex(wire))


def test_strings_are_read_tolerantly() -> None:
    assert decode(DataType.VISIBLE_STRING, b"V1.04\0\0\0") == "V1.04"
    assert decode(DataType.VISIBLE_STRING, b"\xb5m") == "µm"
    assert decode(DataType.UNICODE_STRING, b"\x00\xd8") == "\ufffd"


def test_types_know_their_size_range_and_short_name() -> None:
    assert (DataType.UNSIGNED16.bits, DataType.UNSIGNED16.size) == (16, 2)
    assert (DataType.DOMAIN.bits, DataType.DOMAIN.size) == (None, None)
    assert (DataType.INTEGER32.minimum, DataType.INTEGER32.maximum) == (-2147483648, 2147483647)
    assert (DataType.UNSIGNED8.minimum, DataType.UNSIGNED8.maximum) == (0, 255)
    assert (DataType.BOOLEAN.minimum, DataType.BOOLEAN.maximum) == (0, 1)
    assert [t.short for t in (DataType.UNSIGNED32, DataType.INTEGER8, DataType.REAL32)] == [
        "U32",
        "I8",
        "F32",
    ]
    assert {t for t in DataType if t.signed} == {
        DataType.INTEGER8,
        DataType.INTEGER16,
        DataType.INTEGER32,
        DataType.INTEGER64,
    }
    assert not DataType.UNICODE_STRING.is_integer
    assert DataType.UNSIGNED64.is_integer


@pytest.mark.parametrize("data_type", [DataType.VISIBLE_STRING, DataType.REAL32, DataType.DOMAIN])
def test_what_is_no_integer_has_no_range(data_type: DataType) -> None:
    with pytest.raises(TypeError, match=data_type.name):
        _ = data_type.maximum


def test_an_address_reads_as_people_write_it() -> None:
    assert str(Address(0x6064)) == "6064h:0"
    assert str(Address(0x607D, 2)) == "607Dh:2"
    assert str(Address(0x1018, 11)) == "1018h:11"


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        (MappedObject(0x6040, 0, 16), 0x60400010),  # manual §3.1.16
        (MappedObject(0x607A, 0, 32), 0x607A0020),
        (MappedObject(0x6061, 0, 8), 0x60610008),
        (MappedObject(0x2703, 1, 8), 0x27030108),
    ],
)
def test_a_mapping_entry_is_index_sub_and_bits(entry: MappedObject, value: int) -> None:
    assert entry.encode() == value
    assert MappedObject.decode(value) == entry
    assert entry.address == Address(entry.index, entry.sub)


def test_a_mapping_entry_that_does_not_fit_is_refused() -> None:
    for entry in (MappedObject(0x10000, 0, 8), MappedObject(0x6040, 256, 8), MappedObject(0x6040, 0, -1)):
        with pytest.raises(ValueError, match="mapping entry"):
            entry.encode()
