"""Operations in the store: written down before anything is sent, and again whenever their state changes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from app.operations.schemas import OperationReply
from app.store.database import Database
from app.store.sqlite import Statement

_COLUMNS = "id, created, ended, state, key, document"


def written(reply: OperationReply, key: str | None) -> Statement:
    """The statement that writes an operation as it is now."""
    return Statement(
        f"INSERT OR REPLACE INTO operations ({_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?)",
        (
            reply.id,
            reply.created.timestamp(),
            None if reply.ended is None else reply.ended.timestamp(),
            reply.state.value,
            key,
            reply.model_dump_json(),
        ),
    )


def removed(operation_id: str) -> Statement:
    """The statement that takes back an operation which was refused, so that nothing was sent."""
    return Statement("DELETE FROM operations WHERE id = ?", (operation_id,))


def pruned(before: float, kept: int) -> tuple[Statement, ...]:
    """The statements that forget what ended before a time (seconds since 1970), and all but the newest."""
    return (
        Statement("DELETE FROM operations WHERE ended < ?", (before,)),
        Statement(
            "DELETE FROM operations WHERE ended IS NOT NULL AND id NOT IN "
            "(SELECT id FROM operations ORDER BY created DESC, id DESC LIMIT ?)",
            (kept,),
        ),
    )


async def find(store: Database, operation_id: str) -> OperationReply | None:
    """One operation. Raises `StoreOff`."""
    rows = await store.rows("SELECT document FROM operations WHERE id = ?", operation_id)
    return next(_replies(rows), None)


async def newest(
    store: Database, limit: int, *, state: str | None = None, before: str | None = None
) -> list[OperationReply]:
    """The newest first; only those in a state, or older than the operation `before`. Raises `StoreOff`."""
    rows = await store.rows(
        "SELECT document FROM operations WHERE (?1 IS NULL OR state = ?1) AND (?2 IS NULL OR (created, id) < "
        "(SELECT created, id FROM operations WHERE id = ?2)) ORDER BY created DESC, id DESC LIMIT ?3",
        state,
        before,
        limit,
    )
    return list(_replies(rows))


async def unended(store: Database) -> list[tuple[OperationReply, str | None]]:
    """What had not ended when the service did, with the keys. Raises `StoreOff`."""
    rows = await store.rows("SELECT document, key FROM operations WHERE ended IS NULL ORDER BY created")
    return [(OperationReply.model_validate_json(document), key) for document, key in rows]


def _replies(rows: Iterable[tuple[str, ...]]) -> Iterator[OperationReply]:
    return (OperationReply.model_validate_json(row[0]) for row in rows)
