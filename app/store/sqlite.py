"""Statements, and what carries them out: an SQLite file, or memory."""

from __future__ import annotations

import asyncio
import contextlib
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

import aiosqlite

Value: TypeAlias = str | int | float | bytes | None
Row: TypeAlias = tuple[Any, ...]


class Statement(NamedTuple):
    """One SQL statement and its values."""

    sql: str
    values: Sequence[Value] = ()


class Connection(Protocol):
    """What both connections can do."""

    async def run(self, statements: Sequence[Statement]) -> None:
        """Carry all of them out, or none. Raises `sqlite3.Error`."""
        ...

    async def rows(self, statement: Statement) -> list[Row]:
        """What a SELECT finds. Raises `sqlite3.Error`."""
        ...

    async def close(self) -> None:
        """Let it go."""
        ...


class InFile:
    """A file, worked on in aiosqlite's thread."""

    def __init__(self, connection: aiosqlite.Connection) -> None:
        self._connection = connection

    @classmethod
    async def open(cls, path: Path) -> InFile:
        """Open the file, or make it. Raises `sqlite3.Error`."""
        connection = await aiosqlite.connect(path, isolation_level=None, timeout=1.0)
        try:
            await connection.execute("PRAGMA journal_mode = WAL")
            # A killed process loses nothing; after a power cut the last second may be missing, never torn.
            await connection.execute("PRAGMA synchronous = NORMAL")
        except BaseException:
            await connection.close()
            raise
        return cls(connection)

    async def run(self, statements: Sequence[Statement]) -> None:
        """All of them, or none."""
        await self._connection.execute("BEGIN IMMEDIATE")
        try:
            # Handed over together, carried out in order: the thread is asked once, not for each of them.
            await asyncio.gather(*(self._connection.execute(*statement) for statement in statements))
            await self._connection.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):
                await self._connection.execute("ROLLBACK")
            raise

    async def rows(self, statement: Statement) -> list[Row]:
        """What a SELECT finds."""
        return [tuple(row) for row in await self._connection.execute_fetchall(*statement)]

    async def close(self) -> None:
        """Let it go."""
        await self._connection.close()


class InMemory:
    """No file and no thread: it never waits for anything."""

    def __init__(self) -> None:
        self._connection = sqlite3.connect(":memory:", isolation_level=None)

    async def run(self, statements: Sequence[Statement]) -> None:
        """All of them, or none."""
        self._connection.execute("BEGIN")
        try:
            for sql, values in statements:
                self._connection.execute(sql, values)
            self._connection.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):
                self._connection.execute("ROLLBACK")
            raise

    async def rows(self, statement: Statement) -> list[Row]:
        """What a SELECT finds."""
        return self._connection.execute(*statement).fetchall()

    async def close(self) -> None:
        """Let it go."""
        self._connection.close()
