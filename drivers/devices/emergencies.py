"""What an EMCY of a module means: cause, remedy and axis, told apart by code and byte #1 (manual §11)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from drivers.cia301.emcy import Emergency
from drivers.devices.tables import DataError, Table

MODULE = 255
"""Byte #2 of an EMCY that names no axis."""


class Severity(StrEnum):
    """What an EMCY means for the axis it names."""

    INFO = "info"
    """A fault is over or was reset."""
    WARNING = "warning"
    """The drive goes on; something needs attention."""
    FAULT = "fault"
    """The axis, or every axis, stops."""


@dataclass(frozen=True, slots=True)
class EmergencyRow:
    """One row of a module's table."""

    code: int
    detail: int
    """Byte #1, which tells this row from others of the same code."""
    name: str
    """Stable name in snake_case for programs."""
    title: str
    cause: str
    remedy: str
    severity: Severity
    register: int
    """Bits that it sets in the error register, 1001h."""
    per_axis: bool
    """Whether byte #2 names an axis; else it is 255."""
    note: str = ""
    """Where the manual is wrong or silent, and what was chosen."""

    def emergency(self, axis: int | None, register: int | None = None) -> Emergency:
        """The message as a module sends it; `register` = 1001h if other bits are set in it too.

        Raises ValueError if the row needs an axis and has none, or the other way round.
        """
        if self.per_axis != (axis is not None):
            raise ValueError(
                f"EMCY {self.code:04X}h {self.name} {'names' if self.per_axis else 'does not name'} an axis"
            )
        place = MODULE if axis is None else axis
        return Emergency(
            self.code,
            self.register if register is None else register,
            bytes((self.detail, place, 0, 0, 0)),
        )


@dataclass(frozen=True, slots=True)
class EmergencyMeaning:
    """An EMCY that was received, in plain words."""

    code: int
    name: str
    title: str
    cause: str
    remedy: str
    axis: int | None
    """Axis that it names; None = the whole module."""
    severity: Severity


class EmergencyTable:
    """All rows of one module."""

    def __init__(self, rows: Iterable[EmergencyRow], axes: int) -> None:
        """Raises ValueError if two rows can't be told apart."""
        self.rows = tuple(rows)
        self._axes = axes
        self._by_key = {(row.code, row.detail): row for row in self.rows}
        self._by_name = {row.name: row for row in self.rows}
        if not len(self.rows) == len(self._by_key) == len(self._by_name):
            raise ValueError("two rows of the EMCY table share code and byte #1, or a name")

    def row(self, code: int, detail: int) -> EmergencyRow | None:
        """The row of a code with this byte #1; where the code has a single row, that row whatever byte #1 is.

        The latter because byte #1 of many rows is unverified on hardware.
        """
        exact = self._by_key.get((code, detail))
        if exact is not None:
            return exact
        same_code = [row for row in self.rows if row.code == code]
        return same_code[0] if len(same_code) == 1 else None

    def named(self, name: str) -> EmergencyRow:
        """The row with this stable name. Raises KeyError."""
        return self._by_name[name]

    def explain(self, emergency: Emergency) -> EmergencyMeaning:
        """Cause and remedy of an EMCY; one that the table has not is explained by its class (CiA 301)."""
        detail, place = emergency.data[0], emergency.data[1]
        row = self.row(emergency.code, detail)
        axis = place if place < self._axes and (row is None or row.per_axis) else None
        if row is None:
            return _unknown(emergency.code, detail, axis)
        return EmergencyMeaning(row.code, row.name, row.title, row.cause, row.remedy, axis, row.severity)


def read_emergencies(file: Table, axes: int) -> EmergencyTable:
    """From the ``emergency`` tables of one file. Raises DataError."""
    file.text("section")
    register_note = file.text("register_note")
    rows = tuple(_read_row(table, register_note) for table in file.tables("emergency"))
    file.close()
    try:
        return EmergencyTable(rows, axes)
    except ValueError as error:
        raise DataError(f"{file.where}: {error}") from error


def _read_row(table: Table, register_note: str) -> EmergencyRow:
    place = table.text("place")
    if place not in ("axis", "module"):
        raise DataError(f"{table.where}: place is axis or module, not {place}")
    row = EmergencyRow(
        code=table.integer("code"),
        detail=table.integer("detail"),
        name=table.text("name"),
        title=table.text("title"),
        cause=table.text("cause"),
        remedy=table.text("remedy"),
        severity=table.word("severity", Severity),
        register=table.integer("register"),
        per_axis=place == "axis",
        note=" ".join(part for part in (table.text("note", ""), register_note) if part),
    )
    table.close()
    return row


def _unknown(code: int, detail: int, axis: int | None) -> EmergencyMeaning:
    return EmergencyMeaning(
        code,
        "unknown",
        f"Unknown emergency {code:04X}h",
        f"The module reports {_class_of(code)}, with byte #1 = {detail}; its manual has no such row.",
        "Read 1001h and the statusword of each axis, and reset the fault once the cause is gone.",
        axis,
        Severity.FAULT,
    )


# CiA 301 §7.2.7.1, table of emergency error code classes.
_CLASSES = {
    0x00: "that an error was reset or is gone",
    0x10: "a generic error",
    0x20: "a current error",
    0x21: "an input current error",
    0x22: "an internal current error",
    0x23: "an output current error",
    0x30: "a voltage error",
    0x31: "a mains voltage error",
    0x32: "an internal voltage error",
    0x33: "an output voltage error",
    0x40: "a temperature error",
    0x41: "an ambient temperature error",
    0x42: "a device temperature error",
    0x50: "a hardware error",
    0x60: "a software error",
    0x61: "an internal software error",
    0x62: "a user software error",
    0x63: "a data set error",
    0x70: "an error of an additional module",
    0x80: "a monitoring error",
    0x81: "a communication error",
    0x82: "a protocol error",
    0x90: "an external error",
    0xF0: "an error of an additional function",
    0xFF: "a device-specific error",
}


def _class_of(code: int) -> str:
    high = code >> 8
    return _CLASSES.get(high) or _CLASSES.get(high & 0xF0) or "an error of an unknown class"
