"""Positions that were given names."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from canaxis.replies.quantity import Quantity


@dataclass(frozen=True, slots=True)
class NamedPosition:
    """A position that was given a name."""

    name: str
    position: Quantity
    unreferenced: bool
    """Whether the axis goes there though it was not homed."""
    within_limits: bool
    taught: datetime
    taught_by: str


@dataclass(frozen=True, slots=True)
class NamedPositions:
    """The named positions of an axis."""

    positions: tuple[NamedPosition, ...]
