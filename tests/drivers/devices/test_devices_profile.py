"""ObjectSpec and DeviceProfile: look-up, range checks, defaults, meanings; and what holds for every entry."""

from __future__ import annotations

import pytest

from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.sdo import AbortCode
from drivers.cia301.types import encode
from drivers.devices.catalog import Catalog
from drivers.devices.profile import Access, DeviceProfile, Scope, StoreGroup

MAPPABLE = {
    Address(index)
    for index in (
        *(0x2702, 0x6040, 0x6041, 0x6060, 0x6061, 0x6062, 0x6063, 0x6064, 0x606C, 0x607A),
        *(0x6081, 0x6083, 0x6084, 0x60B0, 0x60B1, 0x60FD, 0x60FF),
    )
} | {Address(0x2703, 1), Address(0x270E, 1), Address(0x270E, 2)}


def test_each_entry_lies_where_its_address_says(tmcm_3216: DeviceProfile) -> None:
    for address, spec in tmcm_3216.objects.items():
        assert spec.address == address
        assert tmcm_3216.layout.locate(spec.index) == (spec.base_index, spec.axis)
        assert tmcm_3216.layout.scope(spec.base_index) is spec.scope
        assert (spec.axis is None) == (spec.scope in (Scope.COMMUNICATION, Scope.MODULE))
        assert tmcm_3216.find(address) is spec


def test_entries_are_in_order(tmcm_3216: DeviceProfile) -> None:
    assert list(tmcm_3216.objects) == sorted(tmcm_3216.objects)


def test_the_copies_of_an_object_differ_by_index_and_pdo_data_only(tmcm_3216: DeviceProfile) -> None:
    for spec in tmcm_3216.objects.values():
        if spec.axis:
            first = tmcm_3216.spec(spec.base_index, spec.sub, 0)
            assert (spec.name, spec.type, spec.access, spec.low, spec.high) == (
                (first.name, first.type, first.access, first.low, first.high)
            )
            if spec.scope is Scope.AXIS:
                assert spec.default == first.default


def test_what_is_mappable_is_what_the_manual_says_and_has_a_fixed_size(tmcm_3216: DeviceProfile) -> None:
    mappable = [spec for spec in tmcm_3216.objects.values() if spec.mappable]
    assert {Address(spec.base_index, spec.sub) for spec in mappable} == MAPPABLE
    for spec in mappable:
        assert spec.mapped == MappedObject(spec.index, spec.sub, spec.type.bits or 0)


def test_what_is_not_mappable_gives_no_mapping_entry(tmcm_3216: DeviceProfile) -> None:
    for index in (0x1008, 0x2101, 0x2102, 0x210A, 0x2121, 0x2122, 0x6085):
        with pytest.raises(ValueError, match="can't be mapped"):
            _ = tmcm_3216.spec(index).mapped


def test_every_default_fits_its_type_and_its_range(tmcm_3216: DeviceProfile) -> None:
    for spec in tmcm_3216.objects.values():
        default = spec.default_for(127)
        if default is not None:
            encode(spec.type, default)
            assert spec.check(default) is None, spec.address


def test_every_entry_has_its_section_and_its_words(tmcm_3216: DeviceProfile) -> None:
    for spec in tmcm_3216.objects.values():
        assert spec.section.startswith(tuple("345678910"))
        assert spec.name
        assert spec.description.endswith(".")
        assert not spec.note or spec.note.endswith((".", ")"))


def test_commands_and_set_points_are_never_stored(tmcm_3216: DeviceProfile) -> None:
    commands = {0x6040, 0x6060, 0x607A, 0x60B0, 0x60B1, 0x60FF}
    for spec in tmcm_3216.objects.values():
        if spec.scope is Scope.AXIS:
            stored = spec.access is Access.RW and spec.base_index not in commands
            assert spec.stored is (StoreGroup.AXIS if stored else None), spec.address
    communication = {
        spec.index for spec in tmcm_3216.objects.values() if spec.stored is StoreGroup.COMMUNICATION
    }
    assert communication == {0x2704, 0x2705}


@pytest.mark.parametrize(
    ("index", "sub", "value", "code"),
    [
        (0x2000, 0, 8, None),
        (0x2000, 0, 9, AbortCode.VALUE_TOO_HIGH),
        (0x2095, 0, -3, None),
        (0x2095, 0, -4, AbortCode.VALUE_TOO_LOW),
        (0x2097, 0, 1, AbortCode.INVALID_VALUE),
        (0x2010, 0, 268435456, AbortCode.VALUE_TOO_HIGH),
        (0x605A, 0, 0, AbortCode.VALUE_TOO_LOW),
        (0x605A, 0, 3, AbortCode.INVALID_VALUE),
        (0x605A, 0, 7, AbortCode.VALUE_TOO_HIGH),
        (0x6060, 0, 2, AbortCode.INVALID_VALUE),
        (0x6060, 0, -1, AbortCode.VALUE_TOO_LOW),
        (0x6060, 0, 10, AbortCode.VALUE_TOO_HIGH),
        (0x607A, 0, 2**31, AbortCode.VALUE_TOO_HIGH),
        (0x2005, 0, -1, AbortCode.VALUE_TOO_LOW),
        (0x1400, 2, 0, AbortCode.VALUE_TOO_LOW),
        (0x1400, 2, 241, AbortCode.INVALID_VALUE),
        (0x1400, 2, 254, None),
        (0x2705, 0, 128, AbortCode.INVALID_VALUE),
        (0x1600, 0, 4, AbortCode.VALUE_TOO_HIGH),
    ],
)
def test_a_value_is_refused_with_the_code_that_says_why(
    tmcm_3216: DeviceProfile, index: int, sub: int, value: int, code: AbortCode | None
) -> None:
    assert tmcm_3216.spec(index, sub, 0).check(value) is code


def test_text_has_no_range(tmcm_3216: DeviceProfile) -> None:
    spec = tmcm_3216.spec(0x1008)
    assert spec.check("anything") is None
    assert (spec.minimum, spec.maximum) == (None, None)


def test_unknown_objects_are_not_found(tmcm_3216: DeviceProfile) -> None:
    for index in (0x1003, 0x1006, 0x1021, 0x2014, 0x2600):
        assert tmcm_3216.find(Address(index)) is None
        with pytest.raises(KeyError):
            tmcm_3216.spec(index)


def test_spec_takes_base_index_and_axis_or_a_real_index(tmcm_3216: DeviceProfile) -> None:
    assert tmcm_3216.spec(0x6064, 0, 2).index == 0x7064
    assert tmcm_3216.spec(0x7064) is tmcm_3216.spec(0x6064, axis=2)
    assert tmcm_3216.spec(0x1017, 0, 1).index == 0x1017


def test_the_catalog_knows_a_module_by_name_and_by_identity() -> None:
    catalog = Catalog.load()
    profile = catalog.profile("TMCM-3216")
    assert catalog.models == ("TMCM-3216",)
    assert catalog.identify(0x286, 3216) is profile
    assert catalog.identify(0x286, 1270) is None
    with pytest.raises(KeyError):
        catalog.profile("TMCM-1")


def test_driver_flags_of_any_axis_are_explained(tmcm_3216: DeviceProfile) -> None:
    for index in (0x2102, 0x2302, 0x2502):
        names = [row.name for row in tmcm_3216.explain_bits(Address(index), 0b1000_0101)]
        assert names == ["overcurrent_a", "open_load_a", "overtemperature"]
    assert tmcm_3216.explain_bits(Address(0x6040), 0xFFFF) == ()


def test_option_codes_of_any_axis_are_explained(tmcm_3216: DeviceProfile) -> None:
    meaning = tmcm_3216.explain_code(Address(0x705A), 6)
    assert meaning is not None
    assert meaning.name == "quick_ramp_and_hold"
    assert tmcm_3216.explain_code(Address(0x605A), 3) is None


def test_every_meaning_has_a_cause_and_a_remedy_and_a_place(tmcm_3216: DeviceProfile) -> None:
    meanings = tmcm_3216.meanings
    for address, table in (*meanings.bits.items(), *meanings.codes.items()):
        spec = tmcm_3216.objects[address]
        assert len({row.name for row in table}) == len(table)
        for row in table:
            assert row.title
            assert row.cause.endswith(".")
            assert row.remedy.endswith(".")
        if address in meanings.bits:
            assert all(row.key < (spec.type.bits or 0) for row in table)
        elif spec.allowed is not None:
            assert {row.key for row in table} == set(spec.allowed)


def test_every_bit_of_a_bounded_flag_object_is_explained(tmcm_3216: DeviceProfile) -> None:
    for index in (0x2005, 0x2102, 0x2711):
        spec = tmcm_3216.spec(index)
        assert sum(1 << row.key for row in tmcm_3216.meanings.bits[spec.address]) == spec.maximum


def test_every_abort_code_of_the_standard_is_explained(tmcm_3216: DeviceProfile) -> None:
    for code in AbortCode:
        meaning = tmcm_3216.explain_abort(code)
        assert meaning is not None, code
        assert meaning.cause
        assert meaning.remedy
    assert tmcm_3216.explain_abort(0x12345678) is None
