"""Numbers in the store that only rise."""

from __future__ import annotations

from app.store.database import Database
from app.store.sqlite import Statement


def written(name: str, value: int) -> Statement:
    """The statement that raises a counter; a value that is not higher changes nothing."""
    return Statement(
        "INSERT INTO counters (name, value) VALUES (?, ?) "
        "ON CONFLICT (name) DO UPDATE SET value = max(value, excluded.value)",
        (name, value),
    )


async def find(store: Database, name: str) -> int:
    """Its value; 0 if it was never written. Raises `StoreOff`."""
    rows = await store.rows("SELECT value FROM counters WHERE name = ?", name)
    return rows[0][0] if rows else 0
