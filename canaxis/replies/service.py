"""The whole service: its stop, its wire, whether it is ready."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any


@dataclass(frozen=True, slots=True)
class StopState:
    """Whether motion is refused because everything was stopped."""

    latched: bool
    reason: str | None
    time: datetime | None


@dataclass(frozen=True, slots=True)
class AxisStop:
    """What became of one axis when everything was stopped."""

    node: int
    axis: int
    outcome: str
    """stopped, unreachable or failed"""
    message: str


@dataclass(frozen=True, slots=True)
class StopReport:
    """What a stop for everything found."""

    reason: str | None
    complete: bool
    """Whether every axis was seen to stand."""
    axes: tuple[AxisStop, ...]


@dataclass(frozen=True, slots=True)
class BusStatus:
    """The wire, and what passed over it."""

    name: str
    state: str
    reason: str
    warnings: tuple[str, ...]
    counters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Ready:
    """Whether everything that is configured can be commanded, and what is missing."""

    ready: bool
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
