"""Statements, and what carries them out: an SQLite file, worked on in a thread of its own, or memory.

The thread is ours (decisions/0032): whatever its disk does, it holds up neither the event loop, nor the
closing of it, nor the end of the process.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import queue
import sqlite3
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from sqlite3 import connect
from typing import Any, NamedTuple, ParamSpec, Protocol, TypeAlias, TypeVar

BUSY = 1.0
"""Seconds that SQLite waits for another program's lock on the file."""
THREAD = "store"
"""What the thread of a file is called."""

Value: TypeAlias = str | int | float | bytes | None
Row: TypeAlias = tuple[Any, ...]
P = ParamSpec("P")
T = TypeVar("T")


class Statement(NamedTuple):
    """One SQL statement and its values."""

    sql: str
    values: Sequence[Value] = ()


class Connection(Protocol):
    """What both connections can do. Made and used in one event loop; `close` ends each, opened or not."""

    async def open(self) -> None:
        """Raises `OSError` or `sqlite3.Error`."""
        ...

    async def run(self, statements: Sequence[Statement]) -> None:
        """Write, all or nothing. Raises `OSError` or `sqlite3.Error`."""
        ...

    async def rows(self, statement: Statement) -> list[Row]:
        """What a statement finds. Raises `OSError` or `sqlite3.Error`."""
        ...

    async def close(self, patience: float) -> bool:
        """True once it is closed; False if that takes longer than `patience` seconds: then it is abandoned.

        It is, too, if the caller is cancelled. Raises nothing else.
        """
        ...

    def abandon(self) -> None:
        """Wait for it no more: it ends by itself when the disk lets it. Ask nothing of it afterwards."""
        ...


class InFile:
    """A file, worked on in a thread of its own, one order after the other.

    The thread holds the file's lock from before it opens the file until it has closed it: what hangs in the
    disk still belongs to this service.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._held = contextlib.ExitStack()
        """What has to be closed; touched by the thread alone."""
        self._file: sqlite3.Connection | None = None
        """The thread's alone too."""
        self._thread = _Thread(last=self._held.close)

    async def open(self) -> None:
        """Make the file and its folder if need be. Raises `OSError` if another service uses it."""
        await self._do(self._open)

    async def run(self, statements: Sequence[Statement]) -> None:
        """Write in one transaction, which once begun goes on even if the caller is cancelled."""
        await self._do(lambda: _transact(self._opened(), statements))

    async def rows(self, statement: Statement) -> list[Row]:
        """What a statement finds."""
        return await self._do(lambda: self._opened().execute(*statement).fetchall())

    async def close(self, patience: float) -> bool:
        """Close the file and end the thread, after what it was given before."""
        try:
            async with asyncio.timeout(patience):
                await self._do(self._held.close)
        except TimeoutError:
            return False
        finally:
            self.abandon()
        self._thread.shutdown()  # at once: there is no disk to wait for any more
        return True

    def abandon(self) -> None:
        """Have the thread close the file and end after the order that it is at."""
        self._thread.shutdown(wait=False)

    async def _do(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    # --- in the thread ---

    def _open(self) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._take_lock()
        self._file = connect(self._path, isolation_level=None, timeout=BUSY)
        self._held.callback(_close, self._file)
        self._file.execute("PRAGMA journal_mode = WAL")
        # A killed process loses nothing; after a power cut the last second may be missing, never torn.
        self._file.execute("PRAGMA synchronous = NORMAL")

    def _opened(self) -> sqlite3.Connection:
        if self._file is None:
            raise sqlite3.ProgrammingError("it is not open")
        return self._file

    def _take_lock(self) -> None:
        """One service per file: a second one would end the first one's operations. Raises `OSError`."""
        try:
            import fcntl
        except ImportError:  # Windows: SQLite's own locks must do
            return
        lock = os.open(self._path.with_name(self._path.name + ".lock"), os.O_RDWR | os.O_CREAT, 0o600)
        self._held.callback(os.close, lock)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OSError("another service uses it") from None


class InMemory:
    """No file and no thread: it never waits for anything."""

    def __init__(self) -> None:
        self._memory = connect(":memory:", isolation_level=None)

    async def open(self) -> None:
        """It is open already."""

    async def run(self, statements: Sequence[Statement]) -> None:
        """Write in one transaction."""
        _transact(self._memory, statements)

    async def rows(self, statement: Statement) -> list[Row]:
        """What a statement finds."""
        return self._memory.execute(*statement).fetchall()

    async def close(self, patience: float) -> bool:
        """Forget everything."""
        del patience
        self.abandon()
        return True

    def abandon(self) -> None:
        """Forget everything."""
        self._memory.close()


def _transact(connection: sqlite3.Connection, statements: Sequence[Statement]) -> None:
    connection.execute("BEGIN IMMEDIATE")
    try:
        for statement in statements:
            connection.execute(*statement)
        connection.execute("COMMIT")
    except BaseException:
        with contextlib.suppress(sqlite3.Error):
            connection.execute("ROLLBACK")
        raise


def _close(file: sqlite3.Connection) -> None:
    with contextlib.suppress(sqlite3.Error):  # what can't be closed is of no use to anyone
        file.close()


class _Thread(Executor):
    """One thread that holds nobody up: it is a daemon, unlike those of `ThreadPoolExecutor`.

    SQLite's file bears a process that ends in the middle of a write.
    """

    def __init__(self, last: Callable[[], None]) -> None:
        """`last` is called in the thread at its end."""
        self._last = last
        self._orders: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name=THREAD, daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have `fn` called after what was submitted before, unless its future is cancelled by then."""
        future: Future[T] = Future()

        def order() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(fn(*args, **kwargs))
            except BaseException as error:  # whatever it is, it is the caller's
                future.set_exception(error)

        self._orders.put(order)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the thread after what was submitted; submit nothing afterwards."""
        del cancel_futures
        self._orders.put(None)
        if wait:
            self._thread.join()

    def _work(self) -> None:
        while (order := self._orders.get()) is not None:
            order()
        self._last()
