"""An operation: what was asked, how it ended, and what was seen of its axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from canaxis.replies.quantity import Quantity

ENDED = frozenset({"succeeded", "failed", "cancelled"})
"""States that an operation doesn't leave any more."""


@dataclass(frozen=True, slots=True)
class OperationAxis:
    """An axis that takes part in an operation."""

    node: int
    axis: int
    name: str


@dataclass(frozen=True, slots=True)
class AxisTrack:
    """Where an axis was, was sent and is; None where it is not known."""

    node: int
    axis: int
    start: Quantity | None
    target: Quantity | None
    end: Quantity | None


@dataclass(frozen=True, slots=True)
class Sight:
    """A statusword that differed from the one before."""

    node: int
    axis: int
    after_s: float
    """Seconds since the operation was begun."""
    statusword: str
    position: Quantity | None


@dataclass(frozen=True, slots=True)
class SeenEmergency:
    """An emergency that came while the operation ran."""

    node: int
    axis: int | None
    time: datetime
    code: str
    title: str


@dataclass(frozen=True, slots=True)
class FoundAxis:
    """An axis as it was found after the service had started again."""

    node: int
    axis: int
    time: datetime
    state: str | None
    moving: bool
    position: Quantity | None
    velocity: Quantity | None


@dataclass(frozen=True, slots=True)
class Evidence:
    """What was seen of the axes while the operation ran."""

    axes: tuple[AxisTrack, ...]
    statuswords: tuple[Sight, ...]
    left_out: int
    emergencies: tuple[SeenEmergency, ...]
    found: tuple[FoundAxis, ...] = ()


@dataclass(frozen=True, slots=True)
class Asker:
    """Who asked for an operation."""

    name: str
    address: str


@dataclass(frozen=True, slots=True)
class OperationStatus:
    """A command that takes time: what was asked, how far it is, how it ended."""

    id: str
    kind: str
    axes: tuple[OperationAxis, ...]
    state: str
    """queued, running, succeeded, failed or cancelled."""
    progress: float | None
    """0 to 1, where it can be told."""
    request: Mapping[str, Any]
    result: Mapping[str, Any] | None
    error: Mapping[str, Any] | None
    """The problem why it failed."""
    reason: str | None
    asked_by: Asker
    evidence: Evidence
    created: datetime
    started: datetime | None
    ended: datetime | None
    predicted_s: float | None = None
    """Seconds that it should take, without what it waits for; None while that isn't known."""
    predicted_peak_velocity: Quantity | None = None

    @property
    def done(self) -> bool:
        """Whether it ended, in whatever way."""
        return self.state in ENDED


@dataclass(frozen=True, slots=True)
class OperationStatuses:
    """Operations, the newest first."""

    operations: tuple[OperationStatus, ...]
