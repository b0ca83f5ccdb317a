"""Someone who listens to a bus, and who can be waited on."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from drivers.bus.base import Bus, BusState
from drivers.bus.frame import Frame


class Listener:
    """Keeps what a bus hands over, and wakes who waits for it."""

    def __init__(self, bus: Bus) -> None:
        self.batches: list[list[Frame]] = []
        self.states: list[tuple[BusState, str]] = []
        self._news = asyncio.Event()
        self.stop = bus.subscribe(self._on_frames, self._on_state)

    @property
    def frames(self) -> list[Frame]:
        return [frame for batch in self.batches for frame in batch]

    @property
    def plain(self) -> list[Frame]:
        """The frames without their timestamps, to be compared with what was sent."""
        return [frame._replace(timestamp=0.0) for frame in self.frames]

    async def until(self, condition: Callable[[], bool], seconds: float = 10) -> None:
        async with asyncio.timeout(seconds):
            while not condition():
                self._news.clear()
                await self._news.wait()

    async def count(self, number: int) -> list[Frame]:
        await self.until(lambda: len(self.frames) >= number)
        return self.plain

    async def state(self, state: BusState) -> str:
        """Wait for a state that was, or will be, reported; returns the sentence."""
        await self.until(lambda: any(seen is state for seen, _ in self.states))
        return next(reason for seen, reason in reversed(self.states) if seen is state)

    def _on_frames(self, batch: Sequence[Frame]) -> None:
        self.batches.append(list(batch))
        self._news.set()

    def _on_state(self, state: BusState, reason: str) -> None:
        self.states.append((state, reason))
        self._news.set()
