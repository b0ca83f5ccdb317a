"""Idempotency keys in the store: written with what is begun under them, and again once it is answered."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import NamedTuple

from app.store.database import Database
from app.store.sqlite import Statement

Headers = Sequence[tuple[bytes, bytes]]


class StoredKey(NamedTuple):
    """A key as the store has it; `status` None: its first request was never answered."""

    fingerprint: bytes
    status: int | None
    headers: list[tuple[bytes, bytes]]
    body: bytes


class Unanswered(NamedTuple):
    """A key without an answer, and the operation that was begun under it, as the API shows it (JSON)."""

    key: str
    operation_id: str | None
    document: str | None


def begun(key: str, born: float, fingerprint: bytes) -> Statement:
    """The statement that spends a key; `born` is in seconds since 1970."""
    return Statement(
        "INSERT OR REPLACE INTO keys (key, born, fingerprint) VALUES (?, ?, ?)", (key, born, fingerprint)
    )


def answered(key: str, status: int, headers: Headers, body: bytes) -> Statement:
    """The statement that adds the answer."""
    return Statement(
        "UPDATE keys SET status = ?, headers = ?, body = ? WHERE key = ?",
        (status, _text(headers), body, key),
    )


def freed(key: str) -> Statement:
    """The statement that gives a key back: nothing was carried out under it."""
    return Statement("DELETE FROM keys WHERE key = ?", (key,))


def pruned(before: float, kept: int) -> tuple[Statement, ...]:
    """The statements that forget keys older than a time (seconds since 1970), and all but the newest."""
    return (
        Statement("DELETE FROM keys WHERE born < ?", (before,)),
        Statement(
            "DELETE FROM keys WHERE born < (SELECT born FROM keys ORDER BY born DESC LIMIT 1 OFFSET ?)",
            (kept,),
        ),
    )


async def find(store: Database, key: str, since: float) -> StoredKey | None:
    """A key that was born since then. Raises `StoreOff`."""
    rows = await store.rows(
        "SELECT fingerprint, status, headers, body FROM keys WHERE key = ? AND born >= ?", key, since
    )
    if not rows:
        return None
    fingerprint, status, headers, body = rows[0]
    return StoredKey(fingerprint, status, _headers(headers), body or b"")


async def names(store: Database, since: float, most: int) -> list[tuple[str, float]]:
    """The newest keys with their births, oldest first. Raises `StoreOff`."""
    rows = await store.rows(
        "SELECT key, born FROM keys WHERE born >= ? ORDER BY born DESC LIMIT ?", since, most
    )
    return [(key, born) for key, born in reversed(rows)]


async def unanswered(store: Database, since: float) -> list[Unanswered]:
    """Keys that were in flight when the service ended. Raises `StoreOff`."""
    rows = await store.rows(
        "SELECT keys.key, operations.id, operations.document FROM keys "
        "LEFT JOIN operations ON operations.key = keys.key "
        "WHERE keys.status IS NULL AND keys.born >= ? ORDER BY operations.created",
        since,
    )
    return [Unanswered(*row) for row in rows]


def _text(headers: Headers) -> str:
    return json.dumps([(name.decode("latin-1"), value.decode("latin-1")) for name, value in headers])


def _headers(text: str | None) -> list[tuple[bytes, bytes]]:
    return [(n.encode("latin-1"), v.encode("latin-1")) for n, v in json.loads(text or "[]")]
