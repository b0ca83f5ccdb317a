"""The dictionary against a list typed a second time from the manual's tables, for all three axes."""

from __future__ import annotations

import pytest

from drivers.cia301.objects import Address
from drivers.cia301.types import DataType
from drivers.cia402 import modes
from drivers.cia402.power import PowerState
from drivers.devices.profile import Access, DeviceProfile

# index:sub type access mappable(m or .) lowest highest default; "*" = limit of the type, "-" = none printed.
# Objects once per module first, then those of axis 0, which the other axes have at +200h or +800h.
ONCE = """
1000:0 U32 ro . * * FFFC0192h      1001:0 U8 ro . * * 0           1005:0 U32 rw . * * 80h
1008:0 STR ro . * * TMCM-3216      1009:0 STR ro . * * -          100A:0 STR ro . * * -
1010:0 U8 ro . * * 6   1010:1 U32 rw . * * 1   1010:2 U32 rw . * * 1   1010:3 U32 rw . * * 0
1010:4 U32 rw . * * 1  1010:5 U32 rw . * * 1   1010:6 U32 rw . * * 1
1011:0 U8 ro . * * 6   1011:1 U32 rw . * * 1   1011:2 U32 rw . * * 1   1011:3 U32 rw . * * 0
1011:4 U32 rw . * * 1  1011:5 U32 rw . * * 1   1011:6 U32 rw . * * 1
1015:0 U16 rw . * * 0  1016:0 U8 ro . * * 1    1016:1 U32 rw . * * 0   1017:0 U16 rw . * * 0
1018:1 U32 ro . * * 286h   1018:2 U32 ro . * * 3216   1018:3 U32 ro . * * -   1018:4 U32 ro . * * -
1029:0 U8 ro . * * 2   1029:1 U8 rw . * * 0    1029:2 U8 rw . * * 1
2702:0 U32 ro m * * 0  2703:1 U32 rw m * * 0   2703:2 U32 rw . * * 0
2704:0 U16 rw . 20 1000 1000   2705:0 U8 rw . 1 255 1   2706:1 U32 rw . * * 1
2707:0 U16 ro . 20 1000 1000   2708:0 U8 ro . 1 127 1
270E:1 U32 ro m 0 4095 -   270E:2 U32 ro m 0 4095 -   2711:0 U16 rw . 0 3855 0
"""
PER_AXIS = """
2000:0 U8 rw . 0 8 8   2001:0 U16 rw . * * 200   2002:1 U16 rw . * * 0   2002:2 U16 rw . * * 0
2003:0 U8 rw . * * 128   2004:0 U8 rw . * * 8   2005:0 U32 rw . 0 63 0   200A:0 U16 rw . * * 0
200B:1 U8 rw . 0 1 0   200B:2 U8 rw . 0 1 0   200B:3 U8 rw . 0 1 1
200C:1 U8 rw . * * 0   200C:2 U8 rw . * * 0
2010:0 U32 rw . 0 268435455 0   2011:0 U32 rw . 0 16777215 0   2012:0 U32 rw . 0 16777215 0
2013:0 U32 rw . 0 16777215 0   2015:0 U16 rw . * * 0   2016:0 U32 rw . 0 16777215 0
2017:0 U32 rw . 0 16777215 0   2018:0 U32 rw . 0 16777215 0
2089:0 U16 rw . 0 400 0   208C:0 U8 rw . 0 181 181   208E:0 U8 ro . 0 179 179
2092:0 U8 rw . 0 3 2   2093:0 U8 rw . 0 1 0   2094:0 U8 rw . 0 1 0   2095:0 I8 rw . -3 12 0
2096:0 U8 rw . 0 8 3   2097:0 U8 rw . 0 15 5   2098:0 U8 rw . 0 1 0   2099:0 U8 rw . 0 3 0
209A:0 U8 rw . 0 15 0   209B:0 U8 rw . 0 3 0   209C:0 U8 rw . 0 15 0   209D:0 U8 rw . 0 1 0
209E:0 I8 rw . -63 63 0   20A1:0 U8 rw . 0 1 0   20A2:0 U8 rw . * * 0   20A3:0 U8 rw . 0 3 3
20A4:0 U32 rw . 0 2147483647 0   20A5:0 U32 rw . 0 2147483647 0   20A7:0 U8 rw . 0 1 0
20A8:0 U16 rw . 0 511 0   20A9:0 U8 rw . 0 1 0   20AA:0 U8 rw . 0 1 0
20B0:0 U32 rw . 0 16777215 0   20B1:0 U8 rw . * * 0   20B2:0 U8 rw . * * 0
20B3:0 U32 rw . 0 16777215 0   20B4:0 U16 rw . 0 1023 0   20B5:0 U8 rw . * * 0
20B6:0 U32 rw . 0 16777215 0   20B7:0 U8 rw . 0 1 0   20B8:0 U8 rw . 0 1 0   20B9:0 U8 rw . 0 15 7
2100:0 I32 ro . * * 0   2101:0 U16 ro . 0 1023 0   2102:0 U8 ro . * * 0   2107:0 U8 ro . 0 8 8
210A:0 U16 ro . 0 511 0   2121:0 U8 ro . * * -   2122:0 I32 ro . -16777215 16777215 -
6040:0 U16 rw m * * 0   6041:0 U16 ro m * * -
605A:0 I16 rw . 1 6 2   605B:0 I16 rw . 0 0 0   605C:0 I16 rw . 1 1 1   605D:0 I16 rw . 1 1 1
605E:0 I16 rw . 2 2 2   6060:0 I8 rw m 0 9 0   6061:0 I8 ro m 0 9 0
6062:0 I32 ro m * * -   6063:0 I32 ro m * * -   6064:0 I32 ro m * * -
6065:0 U32 rw . 0 2147483647 0   6067:0 U32 rw . * * FFFFFFFFh   6068:0 U16 rw . * * 0
606A:0 I16 rw . -1 0 -1   606C:0 I32 ro m * * -   607A:0 I32 rw m * * 0   607C:0 I32 rw . * * 0
607D:1 I32 rw . * * -2147483648   607D:2 I32 rw . * * 2147483647
6081:0 U32 rw m * * 0   6082:0 U32 rw . * * 0   6083:0 U32 rw m * * 0   6084:0 U32 rw m * * 0
6085:0 U32 rw . * * 51200   608F:0 U8 ro . 2 2 2   608F:1 U32 rw . 0 2147483647 1   608F:2 U32 ro . 1 1 1
6098:0 I8 rw . 0 35 0   6099:1 U32 rw . * * 0   6099:2 U32 rw . * * 0   609A:0 U32 rw . * * 0
60B0:0 I32 rw m * * 0   60B1:0 I32 rw m * * 0   60C2:0 U8 ro . * * 2   60C2:1 U8 rw . * * 1
60C2:2 I8 rw . -3 3 -3   60F2:0 U16 rw . 0 2 0   60FD:0 U32 ro m * * 0   60FF:0 I32 rw m * * 0
6502:0 U32 ro . * * 1A5h   67FF:0 U32 ro . * * 40192h
"""
# Sub-index 0, for which the manual prints no row.
WITHOUT_SUB_0 = {0x2703: 2, 0x2706: 1, 0x270E: 2}
WITHOUT_SUB_0_PER_AXIS = {0x2002: 2, 0x200B: 3, 0x200C: 2, 0x607D: 2, 0x6099: 2}
# Node-dependent or noted apart, and tested below.
ELSEWHERE = {Address(0x1014), Address(0x1018, 0)}
AXES = (0, 1, 2)
TYPES = {
    "U8": DataType.UNSIGNED8,
    "U16": DataType.UNSIGNED16,
    "U32": DataType.UNSIGNED32,
    "I8": DataType.INTEGER8,
    "I16": DataType.INTEGER16,
    "I32": DataType.INTEGER32,
    "STR": DataType.VISIBLE_STRING,
}


def number(text: str) -> int:
    return int(text[:-1], 16) if text.endswith("h") else int(text)


def rows(text: str) -> list[tuple[str, ...]]:
    words = text.split()
    return list(zip(*(words[n::7] for n in range(7)), strict=True))


def offset(index: int, axis: int) -> int:
    """Written out here on purpose: the layout of the code is under test."""
    return index + axis * (0x200 if index < 0x6000 else 0x800)


def check(profile: DeviceProfile, row: tuple[str, ...], address: Address) -> None:
    _, type_name, access, mappable, low, high, default = row
    spec = profile.objects[address]
    data_type = TYPES[type_name]
    assert spec.type is data_type
    assert spec.access == access
    assert spec.mappable is (mappable == "m")
    if type_name == "STR":
        assert spec.default == (None if default == "-" else default)
        return
    assert spec.minimum == (data_type.minimum if low == "*" else number(low))
    assert spec.maximum == (data_type.maximum if high == "*" else number(high))
    assert spec.default == (None if default == "-" else number(default))


@pytest.mark.parametrize("row", rows(ONCE), ids=lambda row: row[0])
def test_an_object_of_the_module_is_as_the_manual_prints_it(
    tmcm_3216: DeviceProfile, row: tuple[str, ...]
) -> None:
    index, sub = row[0].split(":")
    check(tmcm_3216, row, Address(int(index, 16), int(sub)))


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("row", rows(PER_AXIS), ids=lambda row: row[0])
def test_an_object_of_an_axis_is_as_the_manual_prints_it(
    tmcm_3216: DeviceProfile, row: tuple[str, ...], axis: int
) -> None:
    index, sub = row[0].split(":")
    address = Address(offset(int(index, 16), axis), int(sub))
    check(tmcm_3216, row, address)
    assert tmcm_3216.spec(int(index, 16), int(sub), axis) is tmcm_3216.objects[address]
    assert tmcm_3216.objects[address].axis == axis


def test_there_is_nothing_but_the_objects_of_the_manual(tmcm_3216: DeviceProfile) -> None:
    expected = set(ELSEWHERE) | {Address(index, 0) for index in WITHOUT_SUB_0}
    for text, axes in ((ONCE, (0,)), (PER_AXIS, AXES)):
        for row in rows(text):
            index, sub = row[0].split(":")
            expected |= {Address(offset(int(index, 16), axis), int(sub)) for axis in axes}
    expected |= {Address(offset(index, axis), 0) for index in WITHOUT_SUB_0_PER_AXIS for axis in AXES}
    for start, entries in ((0x1400, 3), (0x1600, 4), (0x1800, 6), (0x1A00, 4)):
        for axis in AXES:
            expected |= {
                Address(start + 0x40 * axis + pdo, sub) for pdo in range(4) for sub in range(entries)
            }
    assert set(tmcm_3216.objects) == expected


def test_sub_index_0_is_there_where_the_manual_has_no_row_for_it(tmcm_3216: DeviceProfile) -> None:
    found = {index: (tmcm_3216.spec(index), count) for index, count in WITHOUT_SUB_0.items()}
    found |= {
        offset(index, axis): (tmcm_3216.spec(index, 0, axis), count)
        for index, count in WITHOUT_SUB_0_PER_AXIS.items()
        for axis in AXES
    }
    for spec, count in found.values():
        assert (spec.type, spec.access, spec.default) == (DataType.UNSIGNED8, Access.RO, count)
        assert "nverified on hardware" in spec.note


def test_sub_index_0_is_the_highest_sub_index_but_for_mappings(tmcm_3216: DeviceProfile) -> None:
    highest: dict[int, int] = {}
    for address in tmcm_3216.objects:
        highest[address.index] = max(address.sub, highest.get(address.index, 0))
    for index, sub in highest.items():
        spec = tmcm_3216.objects[Address(index, 0)]
        if sub and spec.access is Access.RO:
            assert spec.default == sub, spec.address


@pytest.mark.parametrize(
    ("start", "printed", "held"),
    [
        (0x1400, [0x200, 0x300, 0x400, 0x500], [0x40000200, 0x40000300, 0x40000400, 0xC0000500]),
        (0x1800, [0x180, 0x280, 0x380, 0x480], [0x40000180, 0x40000280, 0x40000380, 0xC0000480]),
    ],
)
def test_cob_ids_are_printed_for_axis_0_and_disabled_for_the_others(
    tmcm_3216: DeviceProfile, start: int, printed: list[int], held: list[int]
) -> None:
    for pdo in range(4):
        spec = tmcm_3216.objects[Address(start + pdo, 1)]
        assert (spec.printed_default, spec.node_relative) == (printed[pdo], True)
        assert spec.default_for(5) == held[pdo] + 5
        assert "nverified on hardware" in spec.note
        for further in (0x40, 0x80):
            assert tmcm_3216.objects[Address(start + further + pdo, 1)].default_for(5) == 0xC0000000


@pytest.mark.parametrize(
    ("start", "types", "second"),
    [
        (0x1400, [255, 255, 255, 254], [None, (0x6060, 8), (0x607A, 32), (0x60FF, 32)]),
        (0x1800, [255, 255, 1, 1], [None, (0x6061, 8), (0x6064, 32), (0x606C, 32)]),
    ],
)
@pytest.mark.parametrize("axis", AXES)
def test_transmission_types_and_mappings_are_those_printed_on_every_axis(
    tmcm_3216: DeviceProfile,
    start: int,
    types: list[int],
    second: list[tuple[int, int] | None],
    axis: int,
) -> None:
    first = 0x6040 if start == 0x1400 else 0x6041
    for pdo in range(4):
        communication = start + 0x40 * axis + pdo
        mapping = communication + 0x200
        transmission = tmcm_3216.objects[Address(communication, 2)]
        assert transmission.default == types[pdo]
        assert transmission.allowed is not None
        assert set(transmission.allowed) == {*range(1, 241), 254, 255}
        entry = second[pdo]
        entries = [(first, 16), *([entry] if entry else [])]
        values = [(index + 0x800 * axis) << 16 | bits for index, bits in entries]
        assert tmcm_3216.objects[Address(mapping, 0)].default == len(values)
        assert (tmcm_3216.objects[Address(mapping, 0)].low, tmcm_3216.objects[Address(mapping, 0)].high) == (
            0,
            3,
        )
        assert [tmcm_3216.objects[Address(mapping, sub)].default for sub in (1, 2, 3)] == [
            *values,
            *[0] * (3 - len(values)),
        ]


def test_every_default_mapping_names_an_object_that_can_be_mapped(tmcm_3216: DeviceProfile) -> None:
    for spec in tmcm_3216.objects.values():
        is_mapping = 0x1600 <= spec.base_index < 0x1800 or 0x1A00 <= spec.base_index < 0x1C00
        if is_mapping and spec.sub and spec.default:
            assert isinstance(spec.default, int)
            target = tmcm_3216.objects[Address(spec.default >> 16, spec.default >> 8 & 0xFF)]
            assert target.axis == spec.axis
            assert target.mapped.encode() == spec.default


def test_emcy_identifier_follows_the_node_id(tmcm_3216: DeviceProfile) -> None:
    assert tmcm_3216.spec(0x1014).default_for(1) == 0x81
    assert tmcm_3216.spec(0x1014).default_for(127) == 0xFF


def test_identity_has_four_entries_though_three_are_printed(tmcm_3216: DeviceProfile) -> None:
    spec = tmcm_3216.spec(0x1018)
    assert (spec.default, spec.printed_default) == (4, 3)
    assert "nverified on hardware" in spec.note


def test_only_four_objects_need_the_axis_switched_off(tmcm_3216: DeviceProfile) -> None:
    restricted = {spec.base_index for spec in tmcm_3216.objects.values() if spec.writable_in is not None}
    assert restricted == {0x2005, 0x200B, 0x200C, 0x208C}
    for spec in tmcm_3216.objects.values():
        if spec.base_index in restricted and spec.access.writable:
            assert spec.writable_in == {PowerState.SWITCH_ON_DISABLED}


@pytest.mark.parametrize(
    ("index", "values"),
    [
        (0x2097, {0, *range(2, 16)}),
        (0x208C, {0, 181}),
        (0x208E, {0, 179}),
        (0x20A2, {0, *range(32, 256)}),
        (0x2704, {20, 50, 100, 125, 250, 500, 800, 1000}),
        (0x2705, {*range(1, 128), 255}),
        (0x605A, {1, 2, 5, 6}),
        (0x605B, {0}),
        (0x605C, {1}),
        (0x605D, {1}),
        (0x605E, {2}),
        (0x6060, {0, 1, 3, 6, 8, 9}),
        (0x606A, {0, -1}),
        (0x6098, {0, 1, 2, 3, 5, 17, 18, 19, 21, 33, 34, 35}),
        (0x60F2, {0, 1, 2}),
    ],
)
def test_values_are_those_that_the_manual_lists(
    tmcm_3216: DeviceProfile, index: int, values: set[int]
) -> None:
    allowed = tmcm_3216.spec(index).allowed
    assert allowed is not None
    assert set(allowed) == values
    assert all(allowed.values())


def test_modes_methods_and_identity_agree_with_the_objects(tmcm_3216: DeviceProfile) -> None:
    assert tmcm_3216.spec(0x1000).default == tmcm_3216.device_type == 0xFFFC0192
    assert tmcm_3216.spec(0x1018, 1).default == tmcm_3216.vendor_id == 0x286
    assert tmcm_3216.spec(0x1018, 2).default == tmcm_3216.product_code == 0xC90
    assert tmcm_3216.spec(0x1008).default == tmcm_3216.identity.device_name
    assert tmcm_3216.homing_methods == set(tmcm_3216.spec(0x6098).allowed or ())
    assert tmcm_3216.modes == set(tmcm_3216.spec(0x6060).allowed or ())
    assert set(tmcm_3216.bit_rates) == set(tmcm_3216.spec(0x2704).allowed or ())
    assert tmcm_3216.spec(0x6502).default == modes.mode_bits(tmcm_3216.modes)
