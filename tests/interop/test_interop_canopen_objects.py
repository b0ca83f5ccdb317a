"""Every object by PyPI canopen against a module in another process: read, written at its limits and beyond.

What is expected comes from the EDS as canopen reads it, and from the lists below, which were typed from the
manual; nothing here looks into the simulator.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import canopen
import pytest
from canopen.objectdictionary import INTEGER_TYPES, SIGNED_TYPES, ODVariable
from canopen_kit import (
    AXES,
    EDS,
    NO_OBJECT,
    NO_SUB,
    NOT_ALLOWED,
    READ_ONLY,
    TOO_HIGH,
    TOO_LONG,
    TOO_LOW,
    TOO_SHORT,
    WRONG_STATE,
    Axis,
    connected,
    entries,
    join,
    read_refusal,
    refusal,
    reset,
    simulator,
    upload,
)

pytestmark = pytest.mark.process

OD = canopen.import_od(str(EDS), 1)
STRINGS = (0x1008, 0x1009, 0x100A)
PDO_RECORDS = range(0x1400, 0x1C00)
# With rules of their own, tested apart.
APART = {0x1005, 0x1010, 0x1011, 0x1014, 0x1016, 0x2706, *PDO_RECORDS}

# Between the printed limits, but not among the printed values: 06090030h (index of motor 0, sub, values).
GAPS = [
    (0x2097, 0, [1]),
    (0x208C, 0, [1, 179, 180]),
    (0x20A2, 0, [1, 31]),
    (0x2704, 0, [21, 200, 999]),
    (0x2705, 0, [128, 200, 254]),
    (0x605A, 0, [3, 4]),
    (0x6060, 0, [2, 4, 5, 7]),
    (0x6098, 0, [4, 6, 7, 16, 20, 22, 32]),
]
# §4.2.6, §4.2.8, §4.2.9, §4.2.19: object, sub, packing, a value that is fine.
ONLY_SWITCHED_OFF = [
    (0x2005, 0, "I", 3),
    (0x200B, 1, "B", 1),
    (0x200B, 2, "B", 1),
    (0x200B, 3, "B", 0),
    (0x200C, 1, "B", 9),
    (0x200C, 2, "B", 9),
    (0x208C, 0, "B", 0),
]


@pytest.fixture(scope="module")
def node() -> Iterator[canopen.RemoteNode]:
    with simulator() as port, connected(port) as network:
        yield join(network)


@pytest.fixture
def fresh(node: canopen.RemoteNode) -> canopen.RemoteNode:
    reset(node)
    return node


def size_of(entry: ODVariable) -> int | None:
    return len(entry) // 8 if entry.data_type in INTEGER_TYPES else None


def pack(entry: ODVariable, value: int) -> bytes:
    signed = entry.data_type in SIGNED_TYPES
    return value.to_bytes(len(entry) // 8, "little", signed=signed)


def type_limits(entry: ODVariable) -> tuple[int, int]:
    bits = len(entry)
    if entry.data_type in SIGNED_TYPES:
        return -(1 << bits - 1), (1 << bits - 1) - 1
    return 0, (1 << bits) - 1


def limits(entry: ODVariable) -> tuple[int, int]:
    low, high = type_limits(entry)
    return (low if entry.min is None else entry.min, high if entry.max is None else entry.max)


def located(index: int, axis: int) -> int:
    """§2.6.1, written out once more."""
    if 0x2000 <= index < 0x2200:
        return index + 0x200 * axis
    return index + 0x800 * axis if index >= 0x6000 else index


def name(entry: ODVariable) -> str:
    return f"{entry.index:04X}h:{entry.subindex}"


def wrong_in_reading(node: canopen.RemoteNode) -> list[tuple]:
    """Entries that are not as long as their type, not within their range, or not at their default."""
    wrong: list[tuple] = []
    for entry in entries(OD):
        data = upload(node, entry.index, entry.subindex)
        if size_of(entry) is None:
            if entry.default is not None and data.decode() != entry.default:
                wrong.append((name(entry), data))
            continue
        if len(data) != size_of(entry):
            wrong.append((name(entry), data))
            continue
        value = entry.decode_raw(data)
        assert isinstance(value, int), name(entry)
        low, high = limits(entry)
        if not low <= value <= high or (entry.default is not None and value != entry.default):
            wrong.append((name(entry), value, entry.default))
    return wrong


def test_every_entry_is_read_in_its_length_and_range_and_holds_its_default_after_a_reset(
    fresh: canopen.RemoteNode,
) -> None:
    assert wrong_in_reading(fresh) == []
    # Counted in the manual: 44 of the module, 106 of an axis; and sub-index 0 where it leaves that out.
    assert len(list(entries(OD))) == 44 + 3 + 3 * (106 + 5) + 3 * 4 * (3 + 4 + 6 + 4)


def test_what_the_manual_fixes_is_read(fresh: canopen.RemoteNode) -> None:
    def number(index: int, sub: int, form: str) -> int:
        return struct.unpack("<" + form, upload(fresh, index, sub))[0]

    assert number(0x1000, 0, "I") == 0xFFFC0192
    assert (number(0x1018, 1, "I"), number(0x1018, 2, "I")) == (0x286, 3216)
    assert upload(fresh, 0x1008) == b"TMCM-3216"
    for string in STRINGS:
        assert upload(fresh, string).decode("ascii")
    for axis in AXES:
        drive = Axis(fresh, axis)
        assert drive.read(0x6502, "I") == 0b1_1010_0101  # pp, pv, hm, csp, csv (§5, table 220)
        assert drive.read(0x67FF, "I") & 0xFFFF == 402
        assert drive.status & 0x4F == 0x40
        assert [drive.read(index, "i") for index in (0x6062, 0x6063, 0x6064, 0x606C)] == [0] * 4
        assert drive.read(0x606A, "h") == -1
        assert drive.read(0x6067, "I") == 0xFFFFFFFF
        assert drive.read(0x6085, "I") == 51200


def test_every_rw_entry_takes_its_limits_and_refuses_what_is_beyond(fresh: canopen.RemoteNode) -> None:
    wrong, written = [], 0
    for entry in entries(OD):
        if not entry.writable or entry.index in APART:
            continue
        index, sub = entry.index, entry.subindex
        before = upload(fresh, index, sub)
        low, high = limits(entry)
        for value in (low, high):
            code = refusal(fresh, index, sub, pack(entry, value))
            if code or upload(fresh, index, sub) != pack(entry, value):
                wrong.append((name(entry), value, hex(code)))
        lowest, highest = type_limits(entry)
        for value, expected in (
            (low - 1, TOO_LOW),
            (lowest, TOO_LOW),
            (high + 1, TOO_HIGH),
            (highest, TOO_HIGH),
        ):
            if low <= value <= high or not lowest <= value <= highest:
                continue
            code = refusal(fresh, index, sub, pack(entry, value))
            if code != expected:
                wrong.append((name(entry), value, hex(code)))
        if upload(fresh, index, sub) != pack(entry, high):
            wrong.append((name(entry), "changed by a refused write"))
        if refusal(fresh, index, sub, before):
            wrong.append((name(entry), "not put back"))
        written += 1
    assert wrong == []
    assert wrong_in_reading(fresh) == []
    assert written == 9 + 3 * 86, "counted in the manual"


def test_every_rw_entry_refuses_another_length(fresh: canopen.RemoteNode) -> None:
    wrong = []
    for entry in entries(OD):
        if not entry.writable:
            continue
        index, sub, size = entry.index, entry.subindex, len(entry) // 8
        for length in {size - 1, size + 1} - {0}:
            expected = TOO_LONG if length > size else TOO_SHORT
            code = refusal(fresh, index, sub, bytes(length))
            if code != expected:
                wrong.append((name(entry), length, hex(code)))
    assert wrong == []
    assert wrong_in_reading(fresh) == [], "a refused write changes nothing"


@pytest.mark.parametrize("axis", AXES)
def test_a_segmented_write_of_another_length_is_refused_too(fresh: canopen.RemoteNode, axis: int) -> None:
    for index, size in ((0x2000, 1), (0x2001, 2), (0x2010, 4), (0x6060, 1), (0x605A, 2), (0x607A, 4)):
        for length in {1, 2, 3, 5, 8, 20} - {size}:
            code = refusal(fresh, located(index, axis), 0, bytes(length), segmented=True)
            assert code == (TOO_LONG if length > size else TOO_SHORT), (hex(index), length, hex(code))


def test_every_ro_entry_refuses_to_be_written(fresh: canopen.RemoteNode) -> None:
    wrong = {}
    for entry in entries(OD):
        if entry.writable:
            continue
        code = refusal(fresh, entry.index, entry.subindex, bytes(size_of(entry) or 9))
        if code != READ_ONLY:
            wrong[name(entry)] = hex(code)
    assert wrong == {}
    for axis in AXES:  # printed rw, but ro (CiA 402)
        assert refusal(fresh, located(0x6041, axis), 0, bytes(2)) == READ_ONLY
        assert refusal(fresh, located(0x6061, axis), 0, bytes(1)) == READ_ONLY


@pytest.mark.parametrize("axis", AXES)
def test_values_between_the_limits_that_the_manual_does_not_list_are_refused(
    fresh: canopen.RemoteNode, axis: int
) -> None:
    for index, sub, values in GAPS:
        entry = OD.get_variable(located(index, axis), sub)
        assert entry is not None, f"{index:04X}h:{sub}"
        for value in values:
            code = refusal(fresh, entry.index, sub, pack(entry, value))
            assert code == NOT_ALLOWED, (name(entry), value, hex(code))


@pytest.mark.parametrize("axis", AXES)
def test_some_objects_are_written_in_switch_on_disabled_only(fresh: canopen.RemoteNode, axis: int) -> None:
    drive = Axis(fresh, axis)
    for words, state in (((6,), 0x21), ((7,), 0x23), ((15,), 0x27), ((0,), 0x40)):
        before = [drive.read(index, form, sub) for index, sub, form, _ in ONLY_SWITCHED_OFF]
        drive.control(*words)
        drive.wait(0x6F if state != 0x40 else 0x4F, state)
        expected = 0 if state == 0x40 else WRONG_STATE
        for (index, sub, form, value), old in zip(ONLY_SWITCHED_OFF, before, strict=True):
            code = drive.refused(index, value, form, sub)
            assert code == expected, (hex(index), sub, hex(state), hex(code))
            assert drive.read(index, form, sub) == (value if state == 0x40 else old)


def test_what_is_not_there_is_said_to_be_not_there(fresh: canopen.RemoteNode) -> None:
    missing = [0x0005, 0x1002, 0x1003, 0x1006, 0x100C, 0x1019, 0x1021, 0x1404, 0x143F, 0x1A84, 0x2006, 0x2014]
    missing += [0x2600, 0x2700, 0x2709, 0x5FFF, 0x6000, 0x6042, 0x6071, 0x60C1, 0x7800, 0x9000, 0xFFFF]
    missing += [0x2306, 0x2506, 0x6842, 0x7042]  # holes of axes 1 and 2
    for index in missing:
        assert read_refusal(fresh, index, 0) == NO_OBJECT, hex(index)
        assert refusal(fresh, index, 0, bytes(4)) == NO_OBJECT, hex(index)
    highest: dict[int, int] = {}
    for entry in entries(OD):
        highest[entry.index] = max(highest.get(entry.index, 0), entry.subindex)
    for index, sub in highest.items():
        assert read_refusal(fresh, index, sub + 1) == NO_SUB, hex(index)
        assert refusal(fresh, index, sub + 1, bytes(4)) == NO_SUB, hex(index)


def test_a_segmented_write_of_a_number_is_as_good_as_an_expedited_one(fresh: canopen.RemoteNode) -> None:
    for axis in AXES:
        target = located(0x607A, axis)
        assert refusal(fresh, target, 0, struct.pack("<i", -123456 - axis), segmented=True) == 0
        assert upload(fresh, target) == struct.pack("<i", -123456 - axis)


def test_block_transfer_is_not_supported(fresh: canopen.RemoteNode) -> None:
    with (
        pytest.raises(canopen.SdoAbortedError) as refused,
        fresh.sdo.open(0x1008, block_transfer=True) as stream,
    ):
        stream.read()
    assert refused.value.code == 0x05040001


# --- objects with rules of their own ---


def test_identifiers_of_sync_and_emcy(fresh: canopen.RemoteNode) -> None:
    def write(index: int, value: int) -> int:
        return refusal(fresh, index, 0, struct.pack("<I", value))

    for value in (0x7F + 1, 0x100, 0x6DF):
        assert write(0x1005, value) == 0, hex(value)
    # 29-bit frames and their bits are "always 0" (§3.1.3); restricted identifiers (CiA 301 table 42).
    for value in (0x20000080, 0x00000880, 0x1FFFFFFF, 0x0, 0x7F, 0x101, 0x581, 0x601, 0x701, 0x7FF):
        assert write(0x1005, value) == NOT_ALLOWED, hex(value)
    assert upload(fresh, 0x1005) == struct.pack("<I", 0x6DF)
    assert upload(fresh, 0x1014) == struct.pack("<I", 0x81)
    assert write(0x1014, 0x80000081) == 0
    for value in (0x20000081, 0x00000881, 0x0, 0x601, 0x7FF):
        assert write(0x1014, value) == NOT_ALLOWED, hex(value)
    assert write(0x1014, 0x95) == 0
    assert upload(fresh, 0x1014) == struct.pack("<I", 0x95)


def test_the_consumer_heartbeat_time_takes_a_node_and_a_time(fresh: canopen.RemoteNode) -> None:
    for value in (0, 0x0001FFFF, 127 << 16 | 500, 0x00FF0001):
        assert refusal(fresh, 0x1016, 1, struct.pack("<I", value)) == 0, hex(value)
        assert upload(fresh, 0x1016, 1) == struct.pack("<I", value)
    for value in (0x01000000, 0xFFFFFFFF):  # reserved bits: refused, unverified on hardware
        assert refusal(fresh, 0x1016, 1, struct.pack("<I", value)) == NOT_ALLOWED


@pytest.mark.parametrize(("index", "good"), [(0x1010, b"save"), (0x1011, b"load"), (0x2706, b"save")])
def test_store_and_restore_ask_for_their_signature(
    fresh: canopen.RemoteNode, index: int, good: bytes
) -> None:
    subs = (1,) if index == 0x2706 else (1, 2, 4, 5, 6)
    for sub in subs:
        assert upload(fresh, index, sub) == struct.pack("<I", 1)
        for wrong in (
            b"evas",
            b"daol",
            b"SAVE",
            bytes(4),
            b"\1\0\0\0",
            b"load" if good == b"save" else b"save",
        ):
            code = refusal(fresh, index, sub, wrong)
            assert code & 0xFFFFFFF0 == 0x08000020, (hex(index), sub, wrong, hex(code))
        assert upload(fresh, index, sub) == struct.pack("<I", 1)
    if index != 0x2706:
        assert upload(fresh, index, 3) == bytes(4)
        assert refusal(fresh, index, 3, good) & 0xFFFFFFF0 == 0x08000020
