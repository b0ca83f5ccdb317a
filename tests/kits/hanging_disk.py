"""A disk under the store that hangs when it is told to, for as long as the test wants."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

CLOSE = "close"
"""What to hang in, besides the beginning of a statement."""


class HangingDisk:
    """Whatever file the store opens is on it."""

    def __init__(self) -> None:
        self._hangs_in: str | None = None
        self._reached = threading.Event()
        self._released = threading.Event()

    def hang_in(self, beginning: str) -> None:
        """Hang in the next statement that begins like this, or in `CLOSE`."""
        self._reached.clear()
        self._released.clear()
        self._hangs_in = beginning

    async def reached(self) -> None:
        """Until it hangs."""
        assert await asyncio.to_thread(self._reached.wait, 10)

    def go_on(self) -> None:
        """It works again."""
        self._hangs_in = None
        self._released.set()

    def connect(self, path: Path, **options: Any) -> sqlite3.Connection:
        """As `sqlite3.connect`."""
        disk = self

        class File(sqlite3.Connection):
            def execute(self, sql: str, values: Sequence[Any] = (), /) -> sqlite3.Cursor:
                disk._touch(sql)
                return super().execute(sql, values)

            def close(self) -> None:
                disk._touch(CLOSE)
                super().close()

        return sqlite3.connect(path, factory=File, **options)

    def _touch(self, what: str) -> None:
        if self._hangs_in is not None and what.startswith(self._hangs_in):
            self._reached.set()
            self._released.wait()


@contextmanager
def hanging_disk() -> Iterator[HangingDisk]:
    """Put the store on such a disk; it works at the latest when this ends, and by itself hangs nowhere."""
    disk = HangingDisk()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.store.sqlite.connect", disk.connect)
        try:
            yield disk
        finally:
            disk.go_on()
