"""PDO mappings, and the writes of a remap."""

from __future__ import annotations

import pytest

from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.pdo import (
    Direction,
    PdoConfiguration,
    PdoLengthError,
    PdoMapping,
    WriteStep,
    is_event_driven,
    is_synchronous,
    pdo_communication_index,
    pdo_mapping_index,
    remap_steps,
)
from drivers.cia301.types import CodecError, DataType

STATUS = PdoMapping(
    (MappedObject(0x6041, 0, 16), MappedObject(0x6064, 0, 32), MappedObject(0x6061, 0, 8)),
    (DataType.UNSIGNED16, DataType.INTEGER32, DataType.INTEGER8),
)


def test_a_mapping_packs_its_entries_one_after_the_other() -> None:
    assert (STATUS.bits, STATUS.size) == (56, 7)
    assert STATUS.pack((0x0637, -2, 1)) == bytes.fromhex("37 06 FE FF FF FF 01")
    assert STATUS.unpack(bytes.fromhex("37 06 FE FF FF FF 01")) == (0x0637, -2, 1)


@pytest.mark.parametrize("length", [0, 6, 8])
def test_other_lengths_than_mapped_are_refused(length: int) -> None:
    with pytest.raises(PdoLengthError, match=f"{length} bytes came where 7 are mapped"):
        STATUS.unpack(bytes(length))


@pytest.mark.parametrize("values", [(0x10000, 0, 0), (0, 2**31, 0), (0, 0, -129), (0, 0), (0, 0, 0, 0)])
def test_values_that_do_not_fit_are_refused(values: tuple[int, ...]) -> None:
    with pytest.raises(CodecError, match="6041h:0"):
        STATUS.pack(values)


@pytest.mark.parametrize(
    ("entries", "types", "message"),
    [
        ((MappedObject(0x6041, 0, 16),), (), "1 entries but 0 types"),
        ((MappedObject(0x6041, 0, 32),), (DataType.UNSIGNED16,), "has 16 bits"),
        ((MappedObject(0x1008, 0, 32),), (DataType.VISIBLE_STRING,), "can't be mapped"),
        ((MappedObject(0x6064, 0, 32),) * 3, (DataType.INTEGER32,) * 3, "96 bits"),
    ],
)
def test_a_mapping_that_makes_no_sense_is_refused(
    entries: tuple[MappedObject, ...], types: tuple[DataType, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        PdoMapping(entries, types)


def test_transmission_types_are_told_apart() -> None:
    assert [t for t in range(256) if is_synchronous(t)] == list(range(1, 241))
    assert [t for t in range(256) if is_event_driven(t)] == [0xFE, 0xFF]


def test_records_are_numbered_from_1() -> None:
    assert pdo_communication_index(Direction.RECEIVE, 1) == 0x1400
    assert pdo_communication_index(Direction.RECEIVE, 65) == 0x1440
    assert pdo_communication_index(Direction.TRANSMIT, 132) == 0x1883
    assert pdo_mapping_index(Direction.RECEIVE, 4) == 0x1603
    assert pdo_mapping_index(Direction.TRANSMIT, 129) == 0x1A80
    for number in (0, 513):
        with pytest.raises(ValueError, match=r"1\.\.512"):
            pdo_mapping_index(Direction.TRANSMIT, number)


def test_a_remap_goes_in_the_order_of_the_manual() -> None:
    u8, u16, u32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
    configuration = PdoConfiguration(
        Direction.TRANSMIT, 65, 0x1C1, STATUS, 0xFF, inhibit_time_100us=50, event_timer_ms=100
    )
    assert remap_steps(configuration) == (
        WriteStep(Address(0x1840, 1), u32, 0xC00001C1),
        WriteStep(Address(0x1A40, 0), u8, 0),
        WriteStep(Address(0x1A40, 1), u32, 0x60410010),
        WriteStep(Address(0x1A40, 2), u32, 0x60640020),
        WriteStep(Address(0x1A40, 3), u32, 0x60610008),
        WriteStep(Address(0x1A40, 0), u8, 3),
        WriteStep(Address(0x1840, 2), u8, 0xFF),
        WriteStep(Address(0x1840, 3), u16, 50),
        WriteStep(Address(0x1840, 5), u16, 100),
        WriteStep(Address(0x1840, 1), u32, 0x400001C1),
    )


def test_timers_that_are_not_given_are_not_written() -> None:
    mapping = PdoMapping((MappedObject(0x6040, 0, 16),), (DataType.UNSIGNED16,))
    steps = remap_steps(PdoConfiguration(Direction.RECEIVE, 1, 0x201, mapping, 0xFF))
    assert [str(step.address) for step in steps] == [
        "1400h:1",
        "1600h:0",
        "1600h:1",
        "1600h:0",
        "1400h:2",
        "1400h:1",
    ]


def test_a_disabled_pdo_is_only_deactivated() -> None:
    configuration = PdoConfiguration(Direction.TRANSMIT, 4, 0, STATUS, 0xFF, enabled=False)
    assert remap_steps(configuration) == (WriteStep(Address(0x1803, 1), DataType.UNSIGNED32, 0xC0000000),)


@pytest.mark.parametrize("cob_id", [-1, 0x000, 0x601, 0x701, 0x800])
def test_an_enabled_pdo_gets_no_restricted_identifier(cob_id: int) -> None:
    with pytest.raises(ValueError, match="COB-ID"):
        PdoConfiguration(Direction.TRANSMIT, 1, cob_id, STATUS, 0xFF)
