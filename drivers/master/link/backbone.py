"""What all nodes of a bus share: the wire, the events, the times, the stop latch, and where bugs are
reported.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Coroutine

from drivers.bus.base import Bus
from drivers.bus.frame import Frame
from drivers.errors import BusError, CanaxisError
from drivers.master.ground.counters import NetworkCounters
from drivers.master.ground.timing import Timing
from drivers.master.link.sync import SyncProducer
from drivers.master.plan.configuration import NetworkConfig
from drivers.master.seen.events import EventHub
from drivers.master.seen.stops import StopLatch


class Backbone:
    """Made by the network, handed down to its nodes and axes."""

    def __init__(
        self, bus: Bus, config: NetworkConfig, timing: Timing, on_bug: Callable[[BaseException], None]
    ) -> None:
        self.bus = bus
        self.config = config
        self.timing = timing
        self.events = EventHub()
        self.counters = NetworkCounters()
        self.stop_latched: StopLatch | None = None
        self.closing = False
        """Whether new work is refused because the network is being closed."""
        self.heartbeat_paused = False
        """Whether our heartbeat pauses on purpose, so that every module is about to stop its motors."""
        self.report_bug = on_bug
        self.sync = SyncProducer(self.send, self.withdraw)
        """The only sender of SYNCs."""
        self._tasks: set[asyncio.Task[None]] = set()

    def spawn(self, work: Coroutine[object, object, None], name: str) -> None:
        """Start what leads several axes; it ends with the network at the latest."""
        task = asyncio.get_running_loop().create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._reap)

    async def end_tasks(self) -> None:
        """End what was started so, and wait until it is gone."""
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def _reap(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if error is not None and not isinstance(error, CanaxisError):
            self.report_bug(error)

    def withdraw(self, cob_ids: Collection[int]) -> None:
        """Take back what waits in the transmit queue with these identifiers, and is superseded."""
        self.bus.withdraw(cob_ids)

    def send(self, frame: Frame, urgent: bool = False, answered: bool = True) -> None:
        """Put a frame on the bus, see `Bus.send`. Raises `BusError`."""
        try:
            self.bus.send(frame, urgent=urgent, answered=answered)
        except BusError:
            self.counters.send_failures += 1
            raise
        self.counters.sent += 1
