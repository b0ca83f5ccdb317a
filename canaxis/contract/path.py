"""A trajectory's points as the body of a request: written piece by piece, however many they are."""

from __future__ import annotations

import json
from collections.abc import AsyncIterable, AsyncIterator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

TrajectoryAxis: TypeAlias = tuple[int | str, int | str, str]
"""Node, axis and unit, e.g. ``("stage", "x", "mm")``."""
TrajectoryPoint: TypeAlias = (
    tuple[float, Sequence[float]] | tuple[float, Sequence[float], Sequence[float] | None]
)
"""Seconds, the position of each axis in its unit, and, if they are known, the velocities in unit/s."""
Axes: TypeAlias = Sequence[TrajectoryAxis]
Points: TypeAlias = Iterable[TrajectoryPoint]
AnyPoints: TypeAlias = Iterable[TrajectoryPoint] | AsyncIterable[TrajectoryPoint]
_PIECE = 500
"""Points that are sent at once."""


@dataclass(frozen=True, slots=True)
class PathBody:
    """The body; `points` are asked for when it is sent, and nothing of them is kept."""

    axes: Axes
    points: AnyPoints
    cycle_ms: int

    @property
    def repeatable(self) -> bool:
        """Whether the points can be asked for again, as those of a list can, but not of a generator."""
        return not isinstance(self.points, Iterator | AsyncIterator)

    def pieces(self) -> Iterator[bytes]:
        """The JSON. Raises TypeError for points that only come asynchronously."""
        if not isinstance(self.points, Iterable):
            raise TypeError("points that come asynchronously need an AsyncClient")
        return self._pieces(self.points)

    def _pieces(self, points: Points) -> Iterator[bytes]:
        yield self._head()
        waiting: list[str] = []
        comma = ""
        for point in points:
            waiting.append(_text(point))
            if len(waiting) == _PIECE:
                yield (comma + ",".join(waiting)).encode("ascii")
                waiting.clear()
                comma = ","
        yield (comma * bool(waiting) + ",".join(waiting) + "]}").encode("ascii")

    async def async_pieces(self) -> AsyncIterator[bytes]:
        """The JSON, from either kind of points."""
        if isinstance(self.points, Iterable):
            for piece in self.pieces():
                yield piece
            return
        yield self._head()
        comma = ""
        async for point in self.points:
            yield (comma + _text(point)).encode("ascii")
            comma = ","
        yield b"]}"

    def _head(self) -> bytes:
        axes = [{"node": node, "axis": axis, "unit": unit} for node, axis, unit in self.axes]
        return f'{{"axes":{json.dumps(axes)},"cycle_ms":{self.cycle_ms},"points":['.encode("ascii")


def _text(point: TrajectoryPoint) -> str:
    told: dict[str, object] = {"t": point[0], "positions": list(point[1])}
    if len(point) == 3 and point[2] is not None:
        told["velocities"] = list(point[2])
    return json.dumps(told, allow_nan=False, separators=(",", ":"))
