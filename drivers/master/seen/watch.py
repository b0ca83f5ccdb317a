"""Clocks that the event loop keeps: our heartbeat on absolute deadlines, and watchdogs that cost nothing to
feed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class HeartbeatProducer:
    """Calls `beat` every `period` seconds from the event loop itself, so that a hung loop falls silent.

    The deadlines are absolute: they don't drift. What a busy loop missed is counted through `missed`, never
    made up for in a burst.
    """

    def __init__(self, period: float, beat: Callable[[], None], missed: Callable[[int], None]) -> None:
        self._period = period
        self._beat = beat
        self._missed = missed
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Beat now, and then every period; starts the period anew if it beats already."""
        self.stop()
        self._due(asyncio.get_running_loop().time())

    def stop(self) -> None:
        """Fall silent. Idempotent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _due(self, deadline: float) -> None:
        loop = asyncio.get_running_loop()
        behind = max(0, int((loop.time() - deadline) / self._period))
        if behind:
            self._missed(behind)
        following = deadline + (behind + 1) * self._period
        self._timer = loop.call_at(following, self._due, following)
        self._beat()


class Watchdog:
    """Calls `on_silence` once when it was not fed for `timeout` seconds; the next feeding arms it again.

    Feeding only notes the time. Before a silence counts, frames that wait unread get `grace` seconds.
    """

    def __init__(self, timeout: float, grace: float, on_silence: Callable[[], None]) -> None:
        self._timeout = timeout
        self._grace = grace
        self._on_silence = on_silence
        self._timer: asyncio.TimerHandle | None = None
        self.fed_at: float | None = None
        """Loop time of the last feeding."""

    def feed(self, now: float) -> None:
        """Something was heard at loop time `now`."""
        self.fed_at = now
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_at(now + self._timeout, self._look)

    def stop(self) -> None:
        """Watch no more until the next feeding. Idempotent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        loop = asyncio.get_running_loop()
        assert self.fed_at is not None
        due = self.fed_at + self._timeout
        if loop.time() < due:
            self._timer = loop.call_at(due, self._look)
        else:
            self._timer = loop.call_later(self._grace, self._decide)

    def _decide(self) -> None:
        self._timer = None
        assert self.fed_at is not None
        if asyncio.get_running_loop().time() - self.fed_at < self._timeout:
            self.feed(self.fed_at)
        else:
            self._on_silence()
