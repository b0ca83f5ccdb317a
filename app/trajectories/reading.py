"""A path out of a body, JSON or CSV, into a file of points: read piece by piece, so that a million take no
memory. Blocking: for a thread.

Numbers are kept in the units in which they came, since JSON may name the axes last.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

from app.http.problems import ApiError
from app.http.uploads import CSV, Upload
from drivers.master.together.trajectory_file import PointFile

Events = Iterator[tuple[str, Any]]
"""What ijson makes of JSON: kind and value of each token."""
MOST_AXES = 24
_LONGEST_LINE = 8192
_COLUMN = re.compile(r"(?P<name>[^\[\]]{1,160})\[(?P<unit>[^\[\]]{1,24})\]")
_EXAMPLE_JSON = (
    '{"axes": [{"node": "stage", "axis": "x", "unit": "mm"}], "cycle_ms": 10, '
    '"points": [{"t": 0.0, "positions": [0.0]}, {"t": 1.0, "positions": [2.5]}]}'
)
_EXAMPLE_CSV = "t,stage.x[mm],stage.y[mm],stage.x.v[mm/s],stage.y.v[mm/s]"


class Column(NamedTuple):
    """An axis as the body names it."""

    node: str | None
    axis: str
    """With `node` None: both, with a dot between."""
    unit: str


@dataclass(slots=True)
class Reading:
    """What a body says."""

    points: PointFile
    columns: list[Column] = field(default_factory=list[Column])
    cycle_ms: int | None = None


def read_points(upload: Upload, folder: Path | None) -> Reading:
    """The whole body. Raises `ApiError`: 422 for what is not understood, 503 for a full disk."""
    try:
        return _read_csv(upload.file, folder) if upload.media_type == CSV else _read_json(upload.file, folder)
    except OSError as error:
        raise ApiError("no_room", f"The points could not be put aside: {error.strerror or error}.") from error
    finally:
        upload.file.close()  # its room on the disk is free while the path is followed


def _bad(detail: str, example: str = _EXAMPLE_JSON) -> ApiError:
    return ApiError("bad_request", detail, hint=f"For example: {example}")


# --- JSON ---


def _read_json(file: BinaryIO, folder: Path | None) -> Reading:
    import ijson  # pyright: ignore[reportMissingTypeStubs] - only where there is a path to read

    reader = _JsonReader(cast("Events", ijson.basic_parse(file, use_float=True)), folder)
    try:
        return reader.read()
    except BaseException as error:
        if reader.points is not None:
            reader.points.close()
        if isinstance(error, ijson.JSONError | ValueError | OverflowError | RecursionError):
            raise _bad(f"The body is no JSON as it should be: {str(error)[:200]}") from error
        raise


class _JsonReader:
    """One body, event by event: nothing of it is held but the point that is being read."""

    def __init__(self, events: Events, folder: Path | None) -> None:
        self._events = events
        self._folder = folder
        self._columns: list[Column] | None = None
        self._cycle_ms: int | None = None
        self.points: PointFile | None = None

    def read(self) -> Reading:
        """All of it."""
        self._expect("start_map", "the body must be an object")
        for key in self._keys():
            match key:
                case "axes" if self._columns is None:
                    self._columns = list(self._axes())
                case "cycle_ms" if self._cycle_ms is None:
                    number = self._number("cycle_ms")
                    if not isinstance(number, int):
                        raise _bad("cycle_ms must be a whole number of milliseconds.")
                    self._cycle_ms = number
                case "points" if self.points is None:
                    self._points()
                case _:
                    raise _bad(
                        f"{key[:60]!r} is unknown, or there twice; axes, cycle_ms and points are known."
                    )
        if next(self._events, None) is not None:
            raise _bad("Something follows the object.")
        if self._columns is None or self.points is None:
            raise _bad("axes and points are needed.")
        if self.points.axes != len(self._columns):
            raise _bad(
                f"The points have {self.points.axes} positions, but {len(self._columns)} axes are named."
            )
        return Reading(self.points, self._columns, self._cycle_ms)

    def _next(self) -> tuple[str, Any]:
        event = next(self._events, None)
        if event is None:
            raise _bad("The body ends too early.")
        return event

    def _expect(self, kind: str, otherwise: str) -> Any:
        event, value = self._next()
        if event != kind:
            raise _bad(f"{otherwise[0].upper()}{otherwise[1:]}.")
        return value

    def _keys(self) -> Iterator[str]:
        """Those of an object that was entered."""
        while True:
            event, value = self._next()
            if event == "end_map":
                return
            yield value

    def _number(self, what: str) -> int | float:
        event, value = self._next()
        if event != "number" or not math.isfinite(value):
            raise _bad(f"{what} must be a finite number.")
        return value

    def _axes(self) -> Iterator[Column]:
        self._expect("start_array", "axes must be an array of objects")
        count = 0
        while True:
            event, _ = self._next()
            if event == "end_array":
                return
            count += 1
            if event != "start_map" or count > MOST_AXES:
                raise _bad(f"axes must be an array of 1 to {MOST_AXES} objects.")
            found: dict[str, str] = {}
            for key in self._keys():
                event, value = self._next()
                if key not in ("node", "axis", "unit") or event not in ("string", "number"):
                    raise _bad("An axis has a node, an axis and a unit: names, or numbers of the first two.")
                found[key] = str(value)[:64]
            if len(found) != 3:
                raise _bad("An axis has a node, an axis and a unit.")
            yield Column(found["node"], found["axis"], found["unit"])

    def _points(self) -> None:
        self._expect("start_array", "points must be an array of objects")
        number = 0
        while True:
            event, _ = self._next()
            if event == "end_array":
                break
            if event != "start_map":
                raise _bad(f"Point {number} must be an object.")
            time: float | None = None
            positions: list[float] | None = None
            velocities: list[float] | None = None
            for key in self._keys():
                if key == "t":
                    time = float(self._number(f"t of point {number}"))
                elif key == "positions":
                    positions = self._numbers(number)
                elif key == "velocities":
                    velocities = self._numbers(number)
                else:
                    raise _bad(
                        f"Point {number}: {key[:60]!r} is unknown; t, positions, velocities are known."
                    )
            self._add(number, time, positions, velocities)
            number += 1
        if self.points is None:
            raise _bad("There are no points.")

    def _numbers(self, point: int) -> list[float]:
        self._expect("start_array", f"point {point}: positions and velocities are arrays of numbers")
        found: list[float] = []
        while True:
            event, value = self._next()
            if event == "end_array":
                return found
            if event != "number" or not math.isfinite(value) or len(found) == MOST_AXES:
                raise _bad(f"Point {point}: 1 to {MOST_AXES} finite numbers are expected.")
            found.append(float(value))

    def _add(
        self, number: int, time: float | None, positions: list[float] | None, velocities: list[float] | None
    ) -> None:
        if time is None or not positions:
            raise _bad(f"Point {number} needs t and positions.")
        if self.points is None:
            self.points = PointFile(len(positions), self._folder)
        width = self.points.axes
        if len(positions) != width or (velocities is not None and len(velocities) != width):
            raise _bad(f"Point {number} must have {width} positions, and as many velocities or none.")
        self.points.add(time, positions, velocities)


# --- CSV ---


def _read_csv(file: BinaryIO, folder: Path | None) -> Reading:
    points: PointFile | None = None
    with io.TextIOWrapper(file, encoding="utf-8-sig", newline="") as text:
        rows = csv.reader(iter(lambda: text.readline(_LONGEST_LINE), ""))
        try:
            columns, speeds = _header(next(rows, list[str]()))
            points = PointFile(len(columns), folder)
            width = 1 + len(columns) + len(speeds)
            for row in rows:
                if row:
                    _add_row(points, row, width, speeds)
            if not points.count:
                raise _bad("There are no points.", _EXAMPLE_CSV)
        except BaseException as error:
            if points is not None:
                points.close()
            if isinstance(error, csv.Error | ValueError):
                raise _bad(f"The body is no CSV as it should be: {str(error)[:200]}", _EXAMPLE_CSV) from error
            raise
    return Reading(points, columns)


def _header(cells: list[str]) -> tuple[list[Column], list[int]]:
    """The axes, and where the velocity of each is in a row; empty if there are none."""
    if not cells or cells[0].strip() not in ("t", "t[s]"):
        raise _bad("The first line names the columns, t first.", _EXAMPLE_CSV)
    columns: list[Column] = []
    speeds: dict[tuple[str, str], int] = {}
    for at, cell in enumerate(cells[1:], start=1):
        match = _COLUMN.fullmatch(cell.strip())
        if match is None:
            raise _bad(f"Column {at}: {cell[:60]!r} is no axis with its unit in brackets.", _EXAMPLE_CSV)
        name, unit = match["name"], match["unit"]
        if unit.endswith("/s") and name.endswith(".v"):
            speeds[name.removesuffix(".v"), unit.removesuffix("/s")] = at
        elif speeds:
            raise _bad("Every position comes before the velocities.", _EXAMPLE_CSV)
        else:
            columns.append(Column(None, name, unit))
    if not 1 <= len(columns) <= MOST_AXES:
        raise _bad(f"1 to {MOST_AXES} axes can take part.", _EXAMPLE_CSV)
    wanted = [(column.axis, column.unit) for column in columns]
    if len(set(wanted)) != len(wanted):
        raise _bad("A column is there twice.", _EXAMPLE_CSV)
    if speeds and (set(speeds) != set(wanted) or len(cells) != 1 + 2 * len(columns)):
        raise _bad(
            "Velocities are given for every axis, in its own unit a second, or for none.", _EXAMPLE_CSV
        )
    return columns, [speeds[key] for key in wanted] if speeds else []


def _add_row(points: PointFile, row: list[str], width: int, speeds: list[int]) -> None:
    number = points.count
    if len(row) != width:
        raise _bad(f"Point {number} has {len(row)} columns instead of {width}.", _EXAMPLE_CSV)
    given = [row[at].strip() for at in speeds]
    velocities = [float(text) for text in given] if any(given) else None
    values = [float(text) for text in row[: 1 + points.axes]]
    if not all(map(math.isfinite, (*values, *(velocities or ())))):
        raise _bad(f"Point {number}: every number must be finite.", _EXAMPLE_CSV)
    points.add(values[0], values[1:], velocities)
