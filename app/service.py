"""The running service: what the lifespan makes, and what the routes get from it.

Commands run in tasks of the service, not of the request: a client that vanishes can't cut one in half.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypedDict, TypeVar

import structlog

from app.access.audit import AuditTrail
from app.access.tickets import Tickets
from app.axes.units import Meant
from app.configuration.configuration import Settings
from app.events import journal
from app.events.streams import Streams
from app.health.metrics import Metrics
from app.http.problems import ApiError
from app.idempotency.keys import Keys
from app.jog.jogs import Jogs
from app.leases.leases import Leases
from app.operations.register import OperationRegister
from app.operations.restart import note_what_is_found
from app.positions.positions import Positions
from app.settings.book import SettingsBook
from app.store.database import Database
from drivers.errors import BusDown
from drivers.master.network import Network

T = TypeVar("T")

FIRST_RETRY = 0.5
LAST_RETRY = 5.0
"""Seconds between two tries to open a bus that wasn't there at the start."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis")


class Service:
    """One network, its operations and its event streams."""

    def __init__(
        self, settings: Settings, network: Network, tickets: Tickets, audit: AuditTrail, keys: Keys
    ) -> None:
        self.settings = settings
        self.network = network
        self.tickets = tickets
        self.audit = audit
        self.keys = keys
        self.store = Database(settings.store.file)
        self.operations = OperationRegister(
            self.store,
            network.axis,
            keep_days=settings.store.keep_days,
            keep_number=settings.store.keep_operations,
        )
        self.book = SettingsBook(settings, network, self.store)
        self.meant = Meant()
        """Where moves were meant to end, so that rounding doesn't add up."""
        self.positions = Positions(self.store)
        self.leases = Leases(network, self.store, audit, self._spawn)
        self.streams = Streams(self, settings.server.max_streams)
        self.jogs = Jogs(self, settings.server.max_streams)
        self.metrics = Metrics(self)
        self.bus_problem: str | None = "The bus was not opened yet."
        """Why the network isn't open; None once it is."""
        self.closing = False
        self._tasks: set[asyncio.Task[Any]] = set()
        self._opener: asyncio.Task[None] | None = None
        self._watcher: asyncio.Task[None] | None = None
        self._journal: asyncio.Task[None] | None = None
        self.finder: asyncio.Task[None] | None = None
        """Notes what became of the operations that a restart ended; None if it ended none."""
        self.on_failure: Callable[[], None] | None = None
        """Called when a bug in the drivers came to light; the axes were told to stop by then."""

    async def open(self) -> None:
        """Open store and network; without a bus, go on and try again in the background."""
        await self.store.open()
        await self.book.open()
        self.audit.open()
        if interrupted := await self.operations.take_over():
            log.warning("operations were under way when the service ended", count=len(interrupted))
            self.finder = asyncio.create_task(
                note_what_is_found(self.operations, self.network, interrupted), name="finder"
            )
        await self.keys.open(self.store)
        await self.leases.open()
        self._watcher = asyncio.create_task(self._watch(), name="failure watch")
        events = self.network.events.subscribe(kinds=journal.KINDS)
        self._journal = asyncio.create_task(journal.keep_journal(events), name="journal")
        if not await self._try_open():
            self._opener = asyncio.create_task(self._keep_trying(), name="bus opener")

    async def close(self) -> None:
        """End streams, let commands end, ramp the axes down, disable them, close the network."""
        self.closing = True
        self.streams.close()
        self.jogs.close()
        try:
            background = [task for task in (self._opener, self._watcher) if task is not None]
            for task in background:
                task.cancel()
            await asyncio.gather(*background, return_exceptions=True)
            self.leases.close()
            await self.network.close()
            remaining = [*self._tasks, *(task for task in (self._journal, self.finder) if task is not None)]
            for task in remaining:
                task.cancel()
            await asyncio.gather(*remaining, return_exceptions=True)
        finally:
            await self.audit.close()
            await self.store.close()

    def begin_shutdown(self) -> None:
        """Stop every axis now, refuse new commands, end the streams. Called on the first signal."""
        if self.closing:
            return
        self.closing = True
        log.info("shutting down: all axes are told to stop")
        self.network.latch_stop("The service is shutting down.")
        self.streams.close()
        self.jogs.close()

    def check_open(self) -> None:
        """Raises `ApiError` (503) once the service is shutting down: it takes no new command then."""
        if self.closing:
            raise ApiError("shutting_down", "The service is shutting down and takes no new command.")

    async def command(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a command to its end even if the client goes away. Raises `ApiError` (503) at shutdown."""
        try:
            self.check_open()
        except ApiError:
            work.close()
            raise
        return await self.unconditional(work)

    async def unconditional(self, work: Coroutine[Any, Any, T]) -> T:
        """The same at any time: for stopping."""
        return await asyncio.shield(self._spawn(work))

    def _spawn(self, work: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._reap)
        return task

    def _reap(self, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        if not task.cancelled():
            task.exception()  # seen: whoever awaited it got it too

    async def _watch(self) -> None:
        """What is unexpected ends the service loudly."""
        failure = await self.network.failed()
        log.critical("unexpected failure: the service ends", exc_info=failure)
        if self.on_failure is not None:
            self.on_failure()

    async def _try_open(self) -> bool:
        try:
            await self.network.open()
        except BusDown as error:
            if self.bus_problem != error.message:
                log.warning("bus not open", problem=error.message, hint=error.hint)
            self.bus_problem = error.message
            return False
        self.bus_problem = None
        return True

    async def _keep_trying(self) -> None:
        pause = FIRST_RETRY
        opened = False
        while not opened:
            await asyncio.sleep(pause)
            pause = min(LAST_RETRY, pause * 2)
            opened = await self._try_open()


class LifespanState(TypedDict):
    """What the lifespan hands to every request."""

    service: Service
