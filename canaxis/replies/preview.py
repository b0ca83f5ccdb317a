"""Dry runs: what a command would come to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from canaxis.obstacles import Obstacle
from canaxis.replies.quantity import Quantity
from canaxis.replies.settings import Write


@dataclass(frozen=True, slots=True)
class PathLimits:
    """A way against the limits of its axis."""

    lowest: Quantity
    highest: Quantity
    limit_low: Quantity
    limit_high: Quantity
    within: bool


@dataclass(frozen=True, slots=True)
class Preview:
    """What a command would come to; nothing was sent."""

    kind: str
    accepted: bool
    """Whether it would be taken now."""
    begins: str | None
    """at_once, take_over, replace or queue; None where it would be refused."""
    obstacles: tuple[Obstacle, ...]
    request: Mapping[str, Any]
    predicted_s: float | None
    """Seconds, without what it waits for; of a homing the longest. None: not known."""
    predicted_peak_velocity: Quantity | None
    start: Quantity | None
    end: Quantity | None
    path: PathLimits | None
    assumed: tuple[str, ...]
    writes: tuple[Write, ...]


@dataclass(frozen=True, slots=True)
class PredictedAxis:
    """What one axis of a coordinated move would be told; None where it has no way to go."""

    node: int
    axis: int
    name: str
    start: Quantity
    target: Quantity
    velocity: Quantity | None
    acceleration: Quantity | None
    deceleration: Quantity | None
    predicted_s: float | None
    path: PathLimits
    writes: tuple[Write, ...]
    obstacles: tuple[Obstacle, ...]


@dataclass(frozen=True, slots=True)
class MovesPrediction:
    """What a coordinated move would come to; nothing was sent."""

    ready: bool
    """Whether it would be accepted now."""
    predicted_s: float
    spread_s: float
    """Seconds between the first arrival and the last."""
    axes: tuple[PredictedAxis, ...]
