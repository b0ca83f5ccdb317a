"""One SQLite file (WAL) behind one worker, so that a slow or broken disk never holds a command up for long.

Everything that is written goes through one queue, in order. What must be durable before something happens is
awaited (`commit`), at most for `PATIENCE`; everything else is written behind (`later`). When the file can't
be written, the store says so in `health`, drops what comes, and tries again from time to time: no motor waits
for a disk, and no stop does.
"""

from __future__ import annotations

import asyncio
import contextlib
import sqlite3
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import structlog

from app.store.schema import MIGRATIONS
from app.store.sqlite import Connection, InFile, InMemory, Row, Statement, Value

PATIENCE = 2.0
"""Seconds that a command waits for its record to be durable; then it goes on without."""
RETRY = 5.0
"""Seconds between two tries to use a broken store again."""
CAPACITY = 20_000
"""Jobs that may wait for the disk; more are dropped, and counted."""
BATCH = 256
"""Jobs in one transaction."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.store")


class StoreOff(Exception):
    """The store can't be read now; the text says why."""


@dataclass(frozen=True, slots=True)
class Health:
    """Whether what is written is kept."""

    on: bool
    reason: str = ""
    """Why not, as a sentence."""


@dataclass(slots=True)
class _Job:
    statements: tuple[Statement, ...]
    done: asyncio.Future[bool] | None
    question: asyncio.Future[list[Row]] | None = None


class Database:
    """The store. Made and used in one event loop.

    `path` None keeps everything in memory, for as long as the service runs.
    """

    def __init__(self, path: Path | None, *, retry: float = RETRY, patience: float = PATIENCE) -> None:
        self.path = path
        self.health = Health(False, "The store is not open yet.")
        self.dropped = 0
        """Jobs that were not written because the store was off or full."""
        self.on_return: list[Callable[[], None]] = []
        """Called when the store works again after it didn't: write anew what must not be missing."""
        self._retry = retry
        self._patience = patience
        self._connection: Connection | None = None
        self._jobs: deque[_Job] = deque()
        self._wake = asyncio.Event()
        self._worker: asyncio.Task[None] | None = None
        self._closing = False

    async def open(self) -> None:
        """Open or make the file and bring its schema up to date. Never raises: `health` says how it went.

        If it is cancelled, there is nothing to be closed.
        """
        try:
            await self._try_open()
        except BaseException:
            self._abandon()
            raise
        self._worker = asyncio.create_task(self._work(), name="store")

    async def close(self) -> None:
        """Write what waits, then close the file, each at most for `PATIENCE`. Idempotent.

        A disk that takes longer is left to itself, and so is any if this is cancelled: what it has not taken
        may be missing then, but nothing of it reaches the event loop any more or keeps the process alive.
        """
        self._closing = True
        self._wake.set()
        worker = self._worker
        try:
            if worker is not None:
                await asyncio.wait({worker}, timeout=self._patience)
                worker.cancel()
                await asyncio.wait({worker})  # at once: what it waited for goes on without it
        except asyncio.CancelledError:
            if worker is not None:
                worker.cancel()
            self._abandon()
            raise
        finally:
            self._turn_away()
            self.health = Health(False, "The store is closed.")
        await self._disconnect()

    # --- for its users ---

    async def commit(self, *statements: Statement) -> bool:
        """Write in one transaction; True once it is durable.

        False after `PATIENCE` seconds, or at once while the store is off: the caller goes on without.
        """
        if not self.health.on or not statements:
            self.dropped += bool(statements)
            return False
        done: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._put(_Job(statements, done))
        try:
            async with asyncio.timeout(self._patience):
                return await done
        except TimeoutError:
            self._turn_off(f"The disk did not take a record within {self._patience:g} s.")
            return False

    def later(self, *statements: Statement) -> None:
        """Write in one transaction, behind what waits already. Never waits, never raises."""
        if not self.health.on:
            self.dropped += 1
        elif statements:
            self._put(_Job(statements, None))

    async def rows(self, sql: str, *values: Value) -> list[Row]:
        """What a SELECT finds, everything written before included. Raises `StoreOff`."""
        if not self.health.on:
            raise StoreOff(self.health.reason)
        found: asyncio.Future[list[Row]] = asyncio.get_running_loop().create_future()
        self._put(_Job((Statement(sql, values),), None, found))
        try:
            async with asyncio.timeout(self._patience):
                return await found
        except TimeoutError:
            raise StoreOff(f"The store did not answer within {self._patience:g} s.") from None

    # --- the worker ---

    def _put(self, job: _Job) -> None:
        if len(self._jobs) >= CAPACITY:
            self.dropped += 1
            _refuse(self._jobs.popleft(), "Too much waits for the disk.")
        self._jobs.append(job)
        self._wake.set()

    async def _work(self) -> None:
        while not (self._closing and not self._jobs):
            if self._connection is None:
                await self._come_back()
                continue
            if not self._jobs:
                self._wake.clear()
                await self._wake.wait()
                continue
            await self._serve(self._next_batch())

    def _next_batch(self) -> list[_Job]:
        """One question, or the writes up to the next question."""
        batch = [self._jobs.popleft()]
        while batch[0].question is None and self._jobs and len(batch) < BATCH:
            if self._jobs[0].question is not None:
                break
            batch.append(self._jobs.popleft())
        return batch

    async def _serve(self, batch: list[_Job]) -> None:
        assert self._connection is not None
        question = batch[0].question
        try:
            if question is not None:
                rows = await self._connection.rows(batch[0].statements[0])
                if not question.done():
                    question.set_result(rows)
            else:
                await self._connection.run([s for job in batch for s in job.statements])
                for job in batch:
                    if job.done is not None and not job.done.done():
                        job.done.set_result(True)
            if not self.health.on:  # it was only slow
                self._turn_on()
        except asyncio.CancelledError:
            self._give_up(batch, "The store was closed before the disk answered.")
            raise
        except (sqlite3.Error, OSError) as error:
            reason = f"The store can't be used: {error}."
            self._give_up(batch, reason)
            self._turn_off(reason)
            await self._disconnect()

    def _give_up(self, jobs: Iterable[_Job], reason: str) -> None:
        for job in jobs:
            self.dropped += job.question is None
            _refuse(job, reason)

    async def _come_back(self) -> None:
        """Wait, then try to open the file again."""
        self._turn_away()
        if self._closing:
            return
        self._wake.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._retry):
                while not self._closing:
                    await self._wake.wait()
                    self._wake.clear()
        if not self._closing:
            await self._try_open()

    def _turn_away(self) -> None:
        """What waits for a store that is off is not written."""
        while self._jobs:
            self._give_up([self._jobs.popleft()], self.health.reason)

    # --- the file ---

    async def _try_open(self) -> None:
        try:
            self._connection = InMemory() if self.path is None else InFile(self.path)
            await self._connection.open()
            await self._migrate()
        except (sqlite3.Error, OSError) as error:
            await self._disconnect()
            where = "memory" if self.path is None else str(self.path)
            self._turn_off(f"The store {where} can't be used: {error}.")
        else:
            if self._worker is None:
                self.health = Health(True)
            else:
                self._turn_on()

    def _turn_on(self) -> None:
        self.health = Health(True)
        log.info("history is on again")
        for tell in self.on_return:
            tell()

    def _turn_off(self, reason: str) -> None:
        if self.health.reason != reason:
            log.error("history is off", reason=reason)
        self.health = Health(False, reason)

    async def _migrate(self) -> None:
        assert self._connection is not None
        ((version,),) = await self._connection.rows(Statement("PRAGMA user_version"))
        if version > len(MIGRATIONS):
            raise sqlite3.DatabaseError(
                f"it was written by a newer Canaxis (schema {version}, known are {len(MIGRATIONS)})"
            )
        for number, script in enumerate(MIGRATIONS[version:], start=version + 1):
            steps = [Statement(step) for step in script.split(";") if step.strip()]
            await self._connection.run([*steps, Statement(f"PRAGMA user_version = {number}")])

    async def _disconnect(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None and not await connection.close(self._patience):
            log.error("the disk did not let the store be closed in time", patience_s=self._patience)

    def _abandon(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.abandon()


def _refuse(job: _Job, reason: str) -> None:
    if job.done is not None and not job.done.done():
        job.done.set_result(False)
    if job.question is not None and not job.question.done():
        job.question.set_exception(StoreOff(reason))
