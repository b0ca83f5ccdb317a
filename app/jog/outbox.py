"""What waits for a client: the latest of what changes, and in order what must not be lost. Bounded."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable

from app.jog.schemas import AckMessage, ServerMessage

CAPACITY = 32
"""How many messages that must not be lost may wait."""

Compose = Callable[[float], ServerMessage]
"""Makes a message from the stamp that it goes out with."""


class Overflow(Exception):
    """The client doesn't read: more waits for it than is kept."""


class Outbox:
    """Filled by whatever happens, emptied by one sender."""

    def __init__(self) -> None:
        self._kept: deque[Compose] = deque()
        self._ack: Callable[[float], AckMessage] | None = None
        self._filled = asyncio.Event()
        self._overflown = False

    def put(self, compose: Compose) -> None:
        """Say this, in its turn."""
        if len(self._kept) < CAPACITY:
            self._kept.append(compose)
        else:
            self._overflown = True
        self._filled.set()

    def acknowledge(self, compose: Callable[[float], AckMessage]) -> None:
        """Say this unless a newer one comes first."""
        self._ack = compose
        self._filled.set()

    async def wait(self, seconds: float) -> bool:
        """Wait for something to say; False if nothing came up. Raises `Overflow`, also for what is past."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(0 if self._overflown else seconds):
                await self._filled.wait()
        if self._overflown:
            raise Overflow
        return self._filled.is_set()

    def take(self) -> Compose | None:
        """The next message."""
        if self._kept:
            return self._kept.popleft()
        ack, self._ack = self._ack, None
        if ack is None:
            self._filled.clear()
        return ack
