"""Plain words for the bits of a flag object, for the values of an option code, and for SDO aborts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from drivers.cia301.objects import Address
from drivers.devices.tables import DataError, Table


@dataclass(frozen=True, slots=True)
class Meaning:
    """One bit, value or code, in plain words."""

    key: int
    """Bit number from 0, or the value, or the code."""
    name: str
    """Stable name in snake_case for programs."""
    title: str
    cause: str
    """What it says about the module, or what the module does with it."""
    remedy: str
    """What to do about it, or when to choose it."""
    note: str = ""
    """Where the manual is wrong or silent."""


@dataclass(frozen=True, slots=True)
class Meanings:
    """All of one module, by base address and by abort code."""

    bits: Mapping[Address, tuple[Meaning, ...]]
    """What each bit of a flag object means when it is set."""
    codes: Mapping[Address, tuple[Meaning, ...]]
    """What each value of an option code means."""
    aborts: Mapping[int, Meaning]
    """Where an SDO abort comes from on this module."""


def read_meanings(file: Table) -> Meanings:
    """From the tables ``bits``, ``codes`` and ``aborts`` of one file. Raises DataError."""
    meanings = Meanings(
        _by_address(file.tables("bits")),
        _by_address(file.tables("codes")),
        MappingProxyType({row.key: row for table in file.tables("aborts") for row in _rows(table)}),
    )
    file.close()
    return meanings


def _by_address(tables: tuple[Table, ...]) -> Mapping[Address, tuple[Meaning, ...]]:
    found: dict[Address, tuple[Meaning, ...]] = {}
    for table in tables:
        address = Address(table.integer("index"), table.integer("sub", 0))
        if address in found:
            raise DataError(f"{table.where}: {address} stands there twice")
        found[address] = _rows(table)
    return MappingProxyType(found)


def _rows(table: Table) -> tuple[Meaning, ...]:
    note = table.text("note", "")
    rows: dict[int, Meaning] = {}
    for row in table.tables("row"):
        key = row.integer("key")
        if key in rows:
            raise DataError(f"{row.where}: {key} stands there twice")
        rows[key] = Meaning(
            key, row.text("name"), row.text("title"), row.text("cause"), row.text("remedy"), note
        )
        row.close()
    table.close()
    return tuple(rows.values())
