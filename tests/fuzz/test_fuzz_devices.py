"""The tables of a module: a damaged file is refused with a sentence, and no message is without a meaning."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from drivers.cia301.emcy import Emergency
from drivers.cia301.objects import Address
from drivers.cia301.types import DataType
from drivers.devices.catalog import Catalog, load_profile
from drivers.devices.emergencies import read_emergencies
from drivers.devices.meanings import read_meanings
from drivers.devices.tables import DataError, Table

PROFILE = Catalog.load().profile("TMCM-3216")
_DATA = files("drivers.devices").joinpath("data")
_FOLDER = next(folder for folder in _DATA.iterdir() if folder.joinpath("device.toml").is_file())
TEXTS = {
    file.name: file.read_text(encoding="utf-8") for file in _FOLDER.iterdir() if file.name.endswith(".toml")
}
values = st.one_of(
    st.integers(-3, 300),
    st.integers(-(2**70), 2**70),
    st.text(max_size=8),
    st.booleans(),
    st.floats(),
    st.just([]),
    st.just({}),
    st.lists(st.integers(-3, 9) | st.text(max_size=3), max_size=3),
)


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) of a tree."""
    found: list[tuple[Any, Any]] = []
    if isinstance(tree, dict):
        for key, value in tree.items():
            found += [(tree, key), *places(value)]
    elif isinstance(tree, list):
        for position, value in enumerate(tree):
            found += [(tree, position), *places(value)]
    return found


@st.composite
def damaged(draw: st.DrawFn, name: str) -> dict[str, Any]:
    """A data file with a few entries changed, gone or misspelled."""
    tree = tomllib.loads(TEXTS[name])
    for _ in range(draw(st.integers(1, 3))):
        where = places(tree)
        if not where:
            break
        container, key = where[draw(st.integers(0, len(where) - 1))]
        match draw(st.sampled_from(("value", "gone", "misspelled", "twice"))):
            case "value":
                container[key] = draw(values)
            case "gone":
                del container[key]
            case "misspelled" if isinstance(container, dict):
                container[f"{key}x"] = container.pop(key)
            case "twice" if isinstance(container, list):
                container.append(container[key])
            case _:
                container[key] = None if isinstance(container, dict) else ""
    return tree


@given(damaged("emergencies.toml"), st.integers(1, 3))
def test_a_damaged_table_of_emergencies_is_refused_with_a_sentence(tree: dict[str, Any], axes: int) -> None:
    read_or_refuse(lambda: read_emergencies(Table(tree, "emergencies.toml"), axes))


@given(damaged("meanings.toml"))
def test_a_damaged_table_of_meanings_is_refused_with_a_sentence(tree: dict[str, Any]) -> None:
    read_or_refuse(lambda: read_meanings(Table(tree, "meanings.toml")))


def read_or_refuse(read: Callable[[], object]) -> None:
    try:
        read()
    except DataError as error:
        assert ":" in str(error), "the message names the place"


@settings(max_examples=25, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(st.sampled_from(sorted(TEXTS)), st.integers(0, 1 << 20), st.text(max_size=6), st.integers(0, 40))
@example("device.toml", 0, "[" * 5000, 0)
@example("drive.toml", 0, "\ud800", 0)
def test_a_damaged_file_is_refused_with_a_sentence(name: str, at: int, put: str, instead_of: int) -> None:
    text = TEXTS[name]
    at %= len(text) + 1
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for other, content in TEXTS.items():
            folder.joinpath(other).write_text(content, encoding="utf-8")
        damaged_text = text[:at] + put + text[at + instead_of :]
        folder.joinpath(name).write_bytes(damaged_text.encode("utf-8", "surrogatepass"))
        try:
            profile = load_profile(folder)
        except DataError as error:
            assert str(error)
        else:
            assert profile.axes >= 1


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFF), st.binary(min_size=5, max_size=5))
def test_every_emergency_has_a_cause_a_remedy_and_an_axis_of_the_module(
    code: int, register: int, data: bytes
) -> None:
    meaning = PROFILE.emergencies.explain(Emergency(code, register, data))
    assert meaning.code == code
    assert meaning.title
    assert meaning.cause
    assert meaning.remedy
    assert meaning.axis in (None, *range(PROFILE.axes))
    assert meaning.axis is None or meaning.axis == data[1]


addresses = st.sampled_from(sorted(PROFILE.objects)) | st.builds(
    Address, st.integers(0, 0xFFFF), st.integers(0, 0xFF)
)


@given(addresses, st.integers(DataType.INTEGER64.minimum, DataType.UNSIGNED64.maximum))
def test_every_value_is_explained_by_rows_that_fit_it(address: Address, value: int) -> None:
    for row in PROFILE.explain_bits(address, value):
        assert value >> row.key & 1
    code = PROFILE.explain_code(address, value)
    assert code is None or code.key == value


@given(st.integers(0, 0xFFFFFFFF))
def test_every_abort_code_has_a_remedy_or_none(code: int) -> None:
    meaning = PROFILE.explain_abort(code)
    assert (meaning is None) == (PROFILE.abort_remedy(code) == "")
