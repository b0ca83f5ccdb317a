"""What an axis is set to, and what a change writes to the module."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Write:
    """A parameter that would be written; `old` is None where it isn't known."""

    index: str
    sub: int
    name: str
    old: int | None
    new: int
    unit: str


@dataclass(frozen=True, slots=True)
class AxisSettings:
    """What an axis is set to."""

    node: int
    axis: int
    name: str
    unit: str
    """What positions are shown in."""
    units: tuple[str, ...]
    """What commands may be given in."""
    revision: int | None
    durable: bool
    """Whether changes outlive the service."""
    problem: str | None
    settings: Mapping[str, Any]
    """As `Axis.configure` takes them: numbers as ``{"value": 20, "unit": "mm/s"}``."""
    sources: Mapping[str, str]
    """Where each comes from: revision, file, default or module."""
    written: tuple[Write, ...]
    """What was written to the module by the change that this answers."""
    etag: str
    """Names this state of them."""
