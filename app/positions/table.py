"""Named positions in the store: by node ID and axis number, since those name the motor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from app.store.database import Database
from app.store.sqlite import Statement

_COLUMNS = "node, axis, name, steps, unit, needs_reference, taught, taught_by"

Place = tuple[int, int]
"""Node ID and axis number."""


@dataclass(frozen=True, slots=True)
class NamedPosition:
    """A position that somebody gave a name."""

    name: str
    steps: int
    unit: str
    """The unit that it was taught in; the steps are what counts."""
    needs_reference: bool
    """Whether an axis that was not homed is not sent there: it would count from elsewhere."""
    taught: datetime
    taught_by: str


def written(place: Place, position: NamedPosition) -> Statement:
    """The statement that teaches a position, or teaches it anew."""
    return Statement(
        f"INSERT OR REPLACE INTO positions ({_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
        (
            *(*place, position.name, position.steps, position.unit, position.needs_reference),
            *(position.taught.timestamp(), position.taught_by),
        ),
    )


def removed(place: Place, name: str) -> Statement:
    """The statement that forgets a position."""
    return Statement("DELETE FROM positions WHERE node = ? AND axis = ? AND name = ?", (*place, name))


async def everything(store: Database) -> Mapping[Place, Mapping[str, NamedPosition]]:
    """All positions of all axes, by name. Raises `StoreOff`."""
    found: dict[Place, dict[str, NamedPosition]] = {}
    rows = await store.rows(f"SELECT {_COLUMNS} FROM positions")
    for node, axis, name, steps, unit, needs_reference, taught, taught_by in rows:
        found.setdefault((node, axis), {})[name] = NamedPosition(
            name, steps, unit, bool(needs_reference), datetime.fromtimestamp(taught, UTC), taught_by
        )
    return found
