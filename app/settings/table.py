"""Revisions of settings in the store: each is all that was set at run time, so the newest one says it all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from app.store.database import Database
from app.store.sqlite import Row, Statement

Overlay = Mapping[str, Any]
"""One axis's settings that go over the settings file's; None: back to the default."""
_COLUMNS = "revision, created, who, address, what, document"


@dataclass(frozen=True, slots=True)
class Revision:
    """One of them."""

    number: int
    """From 1; 0 is the settings file alone."""
    created: datetime
    who: str
    address: str
    what: str
    """patch, apply or rollback."""
    overlays: Mapping[str, Overlay]
    """By ``node/axis``, as numbers."""


def written(revision: Revision) -> Statement:
    """The statement that keeps a revision; one of the same number was never answered for."""
    return Statement(
        f"INSERT OR REPLACE INTO settings ({_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?)",
        (
            revision.number,
            revision.created.timestamp(),
            revision.who,
            revision.address,
            revision.what,
            json.dumps(revision.overlays),
        ),
    )


def trimmed(newest: int) -> Statement:
    """The statement that drops what was given up on, but reached a slow disk all the same."""
    return Statement("DELETE FROM settings WHERE revision > ?", (newest,))


async def newest(store: Database, limit: int = 1) -> list[Revision]:
    """The newest first. Raises `StoreOff`."""
    rows = await store.rows(f"SELECT {_COLUMNS} FROM settings ORDER BY revision DESC LIMIT ?", limit)
    return [_revision(row) for row in rows]


async def find(store: Database, number: int) -> Revision | None:
    """One revision. Raises `StoreOff`."""
    rows = await store.rows(f"SELECT {_COLUMNS} FROM settings WHERE revision = ?", number)
    return _revision(rows[0]) if rows else None


def _revision(row: Row) -> Revision:
    number, created, who, address, what, document = row
    return Revision(number, datetime.fromtimestamp(created, UTC), who, address, what, json.loads(document))
