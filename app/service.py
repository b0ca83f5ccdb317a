"""The running service: what the lifespan makes, and what the routes get from it.

Commands run in tasks of the service, not of the request: a client that vanishes can't cut one in half.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypedDict, TypeVar

import structlog

from app import journal
from app.metrics import Metrics
from app.operations import OperationRegister
from app.problems import ApiError
from app.settings import Settings
from app.streams import Streams
from drivers.errors import BusDown
from drivers.master.network import Network

T = TypeVar("T")

FIRST_RETRY = 0.5
LAST_RETRY = 5.0
"""Seconds between two tries to open a bus that wasn't there at the start."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis")


class Service:
    """One network, its operations and its event streams."""

    def __init__(self, settings: Settings, network: Network) -> None:
        self.settings = settings
        self.network = network
        self.operations = OperationRegister()
        self.streams = Streams(self, settings.server.max_streams)
        self.metrics = Metrics(self)
        self.bus_problem: str | None = "The bus was not opened yet."
        """Why the network isn't open; None once it is."""
        self.closing = False
        self._tasks: set[asyncio.Task[Any]] = set()
        self._opener: asyncio.Task[None] | None = None
        self._watcher: asyncio.Task[None] | None = None
        self._journal: asyncio.Task[None] | None = None
        self.on_failure: Callable[[], None] | None = None
        """Called when a bug in the drivers came to light; the axes were told to stop by then."""

    async def open(self) -> None:
        """Open the network; if the bus isn't there, go on without it and try again in the background."""
        self._watcher = asyncio.create_task(self._watch(), name="failure watch")
        events = self.network.events.subscribe(kinds=journal.KINDS)
        self._journal = asyncio.create_task(journal.keep_journal(events), name="journal")
        if not await self._try_open():
            self._opener = asyncio.create_task(self._keep_trying(), name="bus opener")

    async def close(self) -> None:
        """End streams, let commands end, ramp the axes down, disable them, close the network."""
        self.closing = True
        self.streams.close()
        background = [task for task in (self._opener, self._watcher) if task is not None]
        for task in background:
            task.cancel()
        await asyncio.gather(*background, return_exceptions=True)
        await self.network.close()
        remaining = [*self._tasks, *([] if self._journal is None else [self._journal])]
        for task in remaining:
            task.cancel()
        await asyncio.gather(*remaining, return_exceptions=True)

    def begin_shutdown(self) -> None:
        """Stop every axis now, refuse new commands, end the streams. Called on the first signal."""
        if self.closing:
            return
        self.closing = True
        log.info("shutting down: all axes are told to stop")
        self.network.latch_stop("The service is shutting down.")
        self.streams.close()

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
