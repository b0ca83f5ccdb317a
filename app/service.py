"""The running service: its parts made, put together, opened, and closed in the right order.

Nobody but the composition (main, server, commands) knows it. The routes are handed its parts by name.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import TypedDict

import structlog

from app.access.audit import AuditTrail
from app.access.tickets import Tickets
from app.bus.opening import BusOpener
from app.configuration.configuration import Configuration, ObjectsConfiguration, TrajectoryConfiguration
from app.coordinated import views as coordinated
from app.events import journal
from app.events.streams import Streams
from app.events.wire import Told
from app.health.condition import Condition
from app.health.metrics import Measured, Metrics
from app.http.tasks import Tasks
from app.idempotency.keys import Keys
from app.jog.jogs import Jogs
from app.jog.pressing import Means
from app.leases.leases import Leases
from app.moves.meant import Meant
from app.operations.register import OperationRegister
from app.operations.restart import note_what_is_found
from app.positions.positions import Positions
from app.settings.book import SettingsBook
from app.store.database import Database
from drivers.master.motions.motion import MotionKind
from drivers.master.network import Network

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis")


class Parts(TypedDict):
    """What the lifespan hands to every request: the parts, as `app.http.parts.Part` names them."""

    network: Network
    tasks: Tasks
    bus: BusOpener
    leases: Leases
    operations: OperationRegister
    positions: Positions
    meant: Meant
    settings: SettingsBook
    streams: Streams
    jogs: Jogs
    tickets: Tickets
    objects: ObjectsConfiguration
    trajectories: TrajectoryConfiguration
    condition: Condition
    metrics: Metrics


class Service:
    """One network, its operations and its event streams."""

    def __init__(
        self, configuration: Configuration, network: Network, tickets: Tickets, audit: AuditTrail, keys: Keys
    ) -> None:
        most = configuration.server.max_streams
        silence = configuration.server.jog_silence_ms / 1000
        self.network = network
        self.audit = audit
        self.keys = keys
        self.tasks = Tasks()
        self.bus = BusOpener(network)
        self.store = Database(configuration.store.file)
        self.operations = OperationRegister(
            self.store,
            network.axis,
            results={MotionKind.COORDINATED_MOVE: coordinated.result},
            keep_days=configuration.store.keep_days,
            keep_number=configuration.store.keep_operations,
        )
        self.book = SettingsBook(configuration, network, self.store)
        self.leases = Leases(network, self.store, audit, self.tasks.spawn)
        self.streams = Streams(Told(network, self.bus, self.leases, self.operations), most)
        self.jogs = Jogs(Means(self.operations, self.leases, self.tasks, audit, silence), most)
        self.parts = Parts(
            network=network,
            tasks=self.tasks,
            bus=self.bus,
            leases=self.leases,
            operations=self.operations,
            positions=Positions(self.store),
            meant=Meant(),
            settings=self.book,
            streams=self.streams,
            jogs=self.jogs,
            tickets=tickets,
            objects=configuration.objects,
            trajectories=configuration.trajectories,
            condition=Condition(network, self.bus, self.tasks, self.store, audit),
            metrics=Metrics(Measured(network, self.bus, self.operations, self.streams, audit)),
        )
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
        await self.bus.open()

    async def close(self) -> None:
        """End streams, let commands end, ramp the axes down, disable them, close the network.

        Also after an `open` that failed or was cancelled. If this is cancelled itself, it still closes all
        that was opened, each in its own bounds.
        """
        self.tasks.closing = True
        self.streams.close()
        self.jogs.close()
        async with AsyncExitStack() as stack:  # the last comes first, and each whatever becomes of the others
            stack.push_async_callback(self.store.close)
            stack.push_async_callback(self.audit.close)
            stack.push_async_callback(_cancelled, self._journal, self.finder)
            stack.push_async_callback(self.tasks.close)
            stack.push_async_callback(self.network.close)
            stack.callback(self.leases.close)
            stack.push_async_callback(_cancelled, self._watcher)
            stack.push_async_callback(self.bus.close)

    def begin_shutdown(self) -> None:
        """Stop every axis now, refuse new commands, end the streams. Called on the first signal."""
        if self.tasks.closing:
            return
        self.tasks.closing = True
        log.info("shutting down: all axes are told to stop")
        self.network.latch_stop("The service is shutting down.")
        self.streams.close()
        self.jogs.close()

    async def _watch(self) -> None:
        """What is unexpected ends the service loudly."""
        failure = await self.network.failed()
        log.critical("unexpected failure: the service ends", exc_info=failure)
        if self.on_failure is not None:
            self.on_failure()


async def _cancelled(*tasks: asyncio.Task[None] | None) -> None:
    """Cancel tasks that run for as long as the service does, and wait for their ends."""
    there = [task for task in tasks if task is not None]
    for task in there:
        task.cancel()
    await asyncio.gather(*there, return_exceptions=True)
