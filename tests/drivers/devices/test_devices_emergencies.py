"""The EMCY table: every row of manual §11.2, told apart by code and byte #1, with a cause and a remedy."""

from __future__ import annotations

from collections import Counter

import pytest

from drivers.cia301.emcy import Emergency
from drivers.devices.emergencies import EmergencyRow, EmergencyTable, Severity
from drivers.devices.profile import DeviceProfile

# Code, byte #1, and whether byte #2 is an axis (else 255), in the order of the manual.
ROWS = [
    (0x0000, 0, True),
    (0x1000, 1, True),
    (0x1000, 2, True),
    (0x2310, 0, True),
    (0x2311, 0, True),
    (0x2312, 0, True),
    (0x3230, 0, True),
    (0x4310, 1, True),
    (0x4310, 2, True),
    (0x5441, 0, False),
    (0x6320, 0, False),
    (0x8100, 0, False),
    (0x8110, 1, False),
    (0x8110, 2, False),
    (0x8110, 3, False),
    (0x8120, 0, False),
    (0x8130, 0, False),
    (0x8140, 0, False),
    (0x8210, 0, False),
    (0x8220, 0, False),
    (0x8611, 0, True),
    (0xFF00, 0, True),
    (0xFF01, 1, True),
    (0xFF01, 2, True),
    (0xFF01, 3, True),
    (0xFF01, 4, True),
]
# Rows whose byte #1 is derived rather than read.
DERIVED = {0x2312, 0x3230, 0x4310, 0x5441, 0x6320, 0x8100, 0x8110, 0x8120, 0x8130, 0x8140, 0x8210}


@pytest.fixture
def table(tmcm_3216: DeviceProfile) -> EmergencyTable:
    return tmcm_3216.emergencies


def test_the_rows_are_those_of_the_manual(table: EmergencyTable) -> None:
    assert [(row.code, row.detail, row.per_axis) for row in table.rows] == ROWS


def test_a_byte_that_was_derived_is_marked(table: EmergencyTable) -> None:
    assert {row.code for row in table.rows if "Byte #1 derived" in row.note} == DERIVED


@pytest.mark.parametrize(("code", "detail", "per_axis"), ROWS)
def test_each_row_is_sent_and_explained(
    table: EmergencyTable, code: int, detail: int, per_axis: bool
) -> None:
    row = table.row(code, detail)
    assert row is not None
    for axis in (0, 1, 2) if per_axis else (None,):
        message = row.emergency(axis)
        assert message.encode()[:2] == code.to_bytes(2, "little")
        assert message.data == bytes((detail, 255 if axis is None else axis, 0, 0, 0))
        meaning = table.explain(message)
        assert (meaning.code, meaning.name, meaning.axis) == (code, row.name, axis)
        assert meaning.title
        assert meaning.cause.endswith(".")
        assert meaning.remedy.endswith(".")


def test_rows_of_one_code_say_different_things(table: EmergencyTable) -> None:
    counts = Counter(row.code for row in table.rows)
    assert {code: count for code, count in counts.items() if count > 1} == {
        0x1000: 2,
        0x4310: 2,
        0x8110: 3,
        0xFF01: 4,
    }
    assert len({(row.title, row.cause) for row in table.rows}) == len(table.rows)
    assert len({row.name for row in table.rows}) == len(table.rows)


def test_a_reset_clears_the_error_register_and_an_error_sets_its_bit_0(table: EmergencyTable) -> None:
    for row in table.rows:
        assert row.register & 1 == (row.code != 0)


def test_a_single_row_explains_its_code_whatever_byte_1_is(table: EmergencyTable) -> None:
    assert table.explain(Emergency(0x8130, 0x11, bytes((7, 255, 0, 0, 0)))).name == "heartbeat_lost"


def test_an_unknown_byte_1_of_a_code_with_several_rows_is_not_guessed(table: EmergencyTable) -> None:
    meaning = table.explain(Emergency(0xFF01, 0x81, bytes((9, 1, 0, 0, 0))))
    assert (meaning.name, meaning.axis, meaning.severity) == ("unknown", 1, Severity.FAULT)
    assert "byte #1 = 9" in meaning.cause


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x2120, "input current"),
        (0x4210, "device temperature"),
        (0x7300, "additional module"),
        (0xA000, "unknown class"),
    ],
)
def test_an_unknown_code_is_explained_by_its_class(table: EmergencyTable, code: int, words: str) -> None:
    meaning = table.explain(Emergency(code, 1, bytes((0, 255, 0, 0, 0))))
    assert words in meaning.cause
    assert meaning.axis is None
    assert meaning.remedy


def test_a_row_is_found_by_its_name(table: EmergencyTable) -> None:
    assert table.named("undervoltage").code == 0xFF00
    with pytest.raises(KeyError):
        table.named("nothing")


def test_a_message_needs_an_axis_exactly_where_its_row_has_one(table: EmergencyTable) -> None:
    with pytest.raises(ValueError, match="names an axis"):
        table.named("undervoltage").emergency(None)
    with pytest.raises(ValueError, match="does not name an axis"):
        table.named("heartbeat_lost").emergency(1)


def test_two_rows_that_can_not_be_told_apart_are_refused() -> None:
    row = EmergencyRow(0x1000, 1, "one", "t", "c", "r", Severity.FAULT, register=1, per_axis=True)
    other = EmergencyRow(0x1000, 1, "two", "t", "c", "r", Severity.FAULT, register=1, per_axis=True)
    with pytest.raises(ValueError, match="share"):
        EmergencyTable((row, other), axes=3)
