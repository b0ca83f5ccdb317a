"""A stop for everything: that it was given, and what was found of each axis."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True, slots=True)
class StopLatch:
    """A stop for everything that was given and not yet reset."""

    reason: str
    time: datetime


class StopOutcome(enum.StrEnum):
    """What became of one axis in a stop for everything."""

    STOPPED = "stopped"
    """Seen to stand."""
    UNREACHABLE = "unreachable"
    """Its node is away: whether it moves is unknown."""
    FAILED = "failed"
    """Did not come to standstill in time."""


@dataclass(frozen=True, slots=True)
class AxisStop:
    """One axis's line in a stop report."""

    node: int
    axis: int
    outcome: StopOutcome
    message: str


@dataclass(frozen=True, slots=True)
class StopReport:
    """What a stop for everything found, axis by axis."""

    latch: StopLatch
    axes: tuple[AxisStop, ...]

    @property
    def complete(self) -> bool:
        """Whether every axis was seen to stand."""
        return all(axis.outcome is StopOutcome.STOPPED for axis in self.axes)
