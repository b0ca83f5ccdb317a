"""A data file with a mistake is refused with a message that says where."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

import pytest

from drivers.cia301.objects import Address
from drivers.devices.dictionary import index_objects, read_objects
from drivers.devices.layout import AxisLayout
from drivers.devices.profile import ObjectSpec
from drivers.devices.tables import DataError, Table

GOOD = """
scope = "axis"
[[object]]
index = 0x2000
name = "A"
section = "1"
description = "An object."
type = "U8"
access = "rw"
range = [1, 8]
default = 2
"""


def read(text: str, axes: int = 2) -> Mapping[Address, ObjectSpec]:
    return index_objects(read_objects(Table(tomllib.loads(text), "file.toml"), AxisLayout(axes)))


def test_a_good_file_gives_an_entry_for_each_axis() -> None:
    assert list(read(GOOD)) == [Address(0x2000), Address(0x2200)]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('scope = "axis"', 'scope = "module"', "not one of scope module"),
        ("default = 2", "default = 9", "default 9 is outside of the range"),
        ("default = 2", "default = 2.5", "default is neither"),
        ("default = 2", "default = []", "default has no item 0"),
        ("range = [1, 8]", "range = [8, 1]", "range is not"),
        ("range = [1, 8]", "range = [1, 300]", "300 does not fit U8"),
        ("range = [1, 8]", 'range = "1..8"', "range is not a list"),
        ('access = "rw"', 'access = "ro"\nstored = "axis"', "only what can be written"),
        ('access = "rw"', 'access = "rw"\nmapable = true', "unknown key mapable"),
        ('access = "rw"', 'access = "rw"\nmappable = 1', "mappable is not of type bool"),
        ('type = "U8"', 'type = "STR"\nmappable = true', "can't be mapped"),
        ('name = "A"', "", "name is missing"),
        ('name = "A"', "name = 7", "name is not of type str"),
        ("index = 0x2000", "index = true", "index is not of type int"),
    ],
)
def test_a_mistake_is_named(old: str, new: str, words: str) -> None:
    assert old in GOOD
    with pytest.raises(DataError, match=words) as caught:
        read(GOOD.replace(old, new))
    assert "file.toml" in str(caught.value)


def test_an_object_that_stands_twice_is_refused() -> None:
    with pytest.raises(DataError, match="2000h:0 is defined twice"):
        read(GOOD + GOOD.split("\n", 2)[2])


def test_a_value_that_stands_twice_is_refused() -> None:
    with pytest.raises(DataError, match="5 stands there twice"):
        read(GOOD + '[object.allowed]\n"1..5" = "a"\n"5" = "b"\n')


def test_sub_indices_must_follow_each_other() -> None:
    text = """
    scope = "axis"
    [[object]]
    index = 0x2000
    name = "A"
    kind = "array"
    section = "1"
    description = "An array."
    [[object.sub]]
    sub = 1
    name = "First"
    type = "U8"
    access = "rw"
    """
    with pytest.raises(DataError, match="don't follow each other from 0"):
        read(text)
