"""AxisLayout: base index and axis to index, and back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cia301.objects import MappedObject
from drivers.devices.layout import AxisLayout, Scope

THREE = AxisLayout(3)
PDO_BASES = st.sampled_from((0x1400, 0x1600, 0x1800, 0x1A00)).flatmap(
    lambda start: st.integers(start, start + 0x3F)
)
AXIS_BASES = st.one_of(PDO_BASES, st.integers(0x2000, 0x21FF), st.integers(0x6000, 0x67FF))


@given(base=AXIS_BASES, axis=st.integers(0, 2))
def test_what_an_axis_has_is_found_again(base: int, axis: int) -> None:
    assert THREE.locate(THREE.index(base, axis)) == (base, axis)


@given(index=st.integers(0x1000, 0x7FFF))
def test_every_index_is_located_and_put_back(index: int) -> None:
    assert THREE.index(*THREE.locate(index)) == index


@given(index=st.integers(0, 0xFFFF))
def test_no_two_axes_share_an_index(index: int) -> None:
    owners = [
        axis for axis in range(3) for base in (THREE.locate(index)[0],) if THREE.index(base, axis) == index
    ]
    assert len(owners) == (3 if THREE.locate(index)[1] is None else 1)


@pytest.mark.parametrize(
    ("base", "axis", "index"),
    [
        (0x6040, 1, 0x6840),
        (0x2000, 1, 0x2200),
        (0x2000, 2, 0x2400),
        (0x67FF, 2, 0x77FF),
        (0x1400, 1, 0x1440),
        (0x1A03, 2, 0x1A83),
        (0x1017, 2, 0x1017),
        (0x2711, 1, 0x2711),
    ],
)
def test_offsets_are_those_of_the_manual(base: int, axis: int, index: int) -> None:
    assert THREE.index(base, axis) == index


def test_pdo_numbers_are_those_of_the_manual() -> None:
    assert [[THREE.pdo_number(n, axis) for n in (1, 2, 3, 4)] for axis in range(3)] == [
        [1, 2, 3, 4],
        [65, 66, 67, 68],
        [129, 130, 131, 132],
    ]


def test_a_mapping_entry_follows_the_axis_unless_it_is_empty() -> None:
    assert THREE.mapped(MappedObject(0x607A, 0, 32), 2) == MappedObject(0x707A, 0, 32)
    assert THREE.mapped(MappedObject(0x2702, 0, 32), 2) == MappedObject(0x2702, 0, 32)
    assert THREE.mapped(MappedObject(0, 0, 0), 2) == MappedObject(0, 0, 0)


@pytest.mark.parametrize("axis", [-1, 3, None])
def test_an_axis_that_is_not_there_is_refused(axis: int | None) -> None:
    with pytest.raises(ValueError, match="axis"):
        THREE.index(0x6040, axis)


@pytest.mark.parametrize("number", [0, 5])
def test_an_axis_has_four_pdos(number: int) -> None:
    with pytest.raises(ValueError, match="PDOs 1 to 4"):
        THREE.pdo_number(number, 0)


def test_a_module_without_an_axis_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one axis"):
        AxisLayout(0)


def test_a_one_axis_module_has_no_second_copy() -> None:
    assert AxisLayout(1).locate(0x6840) == (0x6840, None)


def test_scopes_follow_the_index() -> None:
    scopes = {
        0x1018: Scope.COMMUNICATION,
        0x1603: Scope.PDO,
        0x2122: Scope.AXIS,
        0x2704: Scope.MODULE,
        0x6040: Scope.AXIS,
    }
    assert {index: THREE.scope(index) for index in scopes} == scopes
