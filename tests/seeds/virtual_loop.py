"""An event loop on a virtual clock that can also stall a part of the process, as a blocked service would.

Nothing waits: when no callback is ready, the clock jumps to the next timer. Callbacks that run in the context
of the service (`SERVICE`) can be held back while everybody else's go on, as if the service had a loop of its
own that is blocked.
"""

from __future__ import annotations

import asyncio
import heapq
from collections import deque
from collections.abc import Callable
from contextvars import Context, ContextVar, copy_context

SERVICE: ContextVar[bool] = ContextVar("SERVICE", default=False)
"""True in the context of the service's tasks and callbacks, and of all that they start."""


def service_context() -> Context:
    """A context for the service."""
    context = copy_context()
    context.run(SERVICE.set, True)
    return context


class Deadlock(Exception):
    """Nothing is ready and no timer is set: whoever waits would wait for ever."""


TURNS = 50_000
"""Turns of the loop at one instant from which on it counts as going round in circles."""


class Livelock(Exception):
    """Callbacks that only cause each other go on at one instant for ever."""


class VirtualLoop(asyncio.BaseEventLoop):
    """See the module. It knows no files, sockets or threads."""

    # what BaseEventLoop has, and its types conceal
    _ready: deque[asyncio.Handle]
    _scheduled: list[asyncio.TimerHandle]
    _stopping: bool

    def __init__(self) -> None:
        super().__init__()
        self._now = 0.0
        self._held: list[asyncio.Handle] = []
        self._stalled_until = 0.0
        self._turns = 0
        self.stalled_in_all = 0.0
        """Virtual seconds for which the service was stalled so far."""
        self.on_instant: Callable[[], None] = lambda: None
        """Called when all that was ready at one instant has run, before the clock moves on."""

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._now

    @property
    def stalled(self) -> bool:
        """Whether the service stands still."""
        return self._now < self._stalled_until

    def stall(self, seconds: float) -> None:
        """Hold back everything of the service for so long."""
        self.stalled_in_all += max(0.0, self._now + seconds - max(self._now, self._stalled_until))
        self._stalled_until = max(self._stalled_until, self._now + seconds)
        self.call_at(self._stalled_until, self._go_on)

    def service_timers(self) -> list[asyncio.TimerHandle]:
        """Timers of the service that are still set."""
        return [handle for handle in self._scheduled if not handle.cancelled() and _of_service(handle)]

    def _go_on(self) -> None:
        if not self.stalled:
            held, self._held = self._held, []
            self._ready.extend(held)

    # --- what BaseEventLoop leaves to its children, and the turn of the loop itself

    def _run_once(self) -> None:
        ready, scheduled = self._ready, self._scheduled
        if not ready:
            while scheduled and scheduled[0].cancelled():
                heapq.heappop(scheduled)._scheduled = False
            self.on_instant()
            if not ready and not self._stopping:
                if not scheduled:
                    raise Deadlock
                self._now = max(self._now, scheduled[0].when())
                self._turns = 0
        while scheduled and scheduled[0].when() <= self._now:
            handle = heapq.heappop(scheduled)
            handle._scheduled = False
            if not handle.cancelled():
                ready.append(handle)
        self._turns += 1
        if self._turns > TURNS:
            raise Livelock(f"at {self._now}: {list(ready)[:5]}")
        stalled = self.stalled
        for _ in range(len(ready)):
            handle = ready.popleft()
            if handle.cancelled():
                continue
            if stalled and _of_service(handle):
                self._held.append(handle)
            else:
                handle._run()

    def _timer_handle_cancelled(self, handle: asyncio.TimerHandle) -> None:
        """A cancelled timer leaves the heap when its time comes."""

    def _process_events(self, event_list: object) -> None:
        """There are none."""

    def _write_to_self(self) -> None:
        """Nobody calls from another thread."""


def _of_service(handle: asyncio.Handle) -> bool:
    context = handle._context
    return context is not None and context.get(SERVICE, False)
