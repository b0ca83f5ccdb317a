"""Points in a file, as compact as can be: a million of them take no memory. Written once, read in order."""

from __future__ import annotations

import array
import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from drivers.master.together.trajectory_path import Point

_BLOCK = 4096
"""Points that are read or written at once."""


class PointFile:
    """Doubles, one after the other: a time, the positions, the velocities (not a number where there are
    none). It has no name on the disk, so that nothing is left behind however the process ends.
    """

    def __init__(self, axes: int, folder: Path | None = None) -> None:
        """Raises OSError if the folder (None: the system's for temporary files) can't be written."""
        self.axes = axes
        self.count = 0
        """Points in it."""
        self.scales: tuple[float, ...] = (1.0,) * axes
        """Steps in one of what the positions were written in."""
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - closed by `close`
        self._block = array.array("d")
        self._missing = [math.nan] * axes

    def add(self, time: float, positions: Sequence[float], velocities: Sequence[float] | None) -> None:
        """One more point. Raises OSError when the disk is full."""
        block = self._block
        block.append(time)
        block.extend(positions)
        block.extend(self._missing if velocities is None else velocities)
        self.count += 1
        if self.count % _BLOCK == 0:
            self._flush()

    def points(self) -> Iterator[Point]:
        """Every point in steps, from the first on; one reader at a time. Raises OSError."""
        self._flush()
        width = 1 + 2 * self.axes
        self._file.seek(0)
        end = 1 + self.axes
        scales = self.scales
        while raw := self._file.read(8 * width * _BLOCK):
            values = array.array("d")
            values.frombytes(raw)
            for at in range(0, len(values), width):
                velocities = None
                if not math.isnan(values[at + end]):
                    velocities = _scaled(values[at + end : at + width], scales)
                yield Point(values[at], _scaled(values[at + 1 : at + end], scales), velocities)

    def close(self) -> None:
        """Give the space back. Idempotent."""
        self._file.close()

    def _flush(self) -> None:
        if self._block:
            self._file.seek(0, 2)
            self._block.tofile(self._file)
            del self._block[:]


def _scaled(values: Sequence[float], scales: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(value * scale for value, scale in zip(values, scales, strict=True))
