"""Waiting as an event loop has it: tasks, their lock, their socket.

All that is not the same in both clients; `canaxis.blocking.waiting` has the same names. Written by hand.
"""

from __future__ import annotations

import abc
import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from typing import Any, Self, TypeVar

from canaxis.websocket import Closed, in_use, library, opening, options

T = TypeVar("T")
Sleep = Callable[[float], Awaitable[None]]
sleep: Sleep = asyncio.sleep


class Opening(abc.ABC):
    """What is opened by entering its `async with`, since to make it can't wait."""

    @abc.abstractmethod
    async def _open(self) -> None: ...

    async def __aenter__(self) -> Self:
        await self._open()
        return self


class Background:
    """Something that is done beside what the program does: by a task."""

    def __init__(self, work: Callable[[], Coroutine[Any, Any, None]], *, name: str) -> None:
        self._work = work
        self._name = name
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin."""
        self._task = asyncio.create_task(self._work(), name=self._name)

    async def pause(self, seconds: float) -> bool:
        """For the work itself: wait; whether to go on then."""
        await asyncio.sleep(seconds)
        return True

    async def end(self, within: float | None = None) -> None:
        """End it, wherever it is, and wait for that: at most `within` seconds."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task}, timeout=within)


class Changed(asyncio.Condition):
    """A lock, and waiting for what others change under it."""

    async def wait_for(self, predicate: Callable[[], T], timeout: float | None = None) -> T:
        """Wait until it is true, at most `timeout` seconds; returns what it was last."""
        try:
            async with asyncio.timeout(timeout):
                return await super().wait_for(predicate)
        except TimeoutError:
            return predicate()


class Socket:
    """A WebSocket."""

    def __init__(self) -> None:
        self._connection: Any = None
        self._ends = contextlib.AsyncExitStack()

    async def open(self, url: str, headers: Mapping[str, str], within: float) -> None:
        """Connect, within some seconds. Raises `CanaxisError`."""
        with opening(url):
            connecting = library("websockets.asyncio.client").connect(url, **options(headers, within))
            self._connection = await self._ends.enter_async_context(connecting)

    async def send(self, text: str) -> None:
        """Send a message. Raises `Closed`."""
        if self._connection is None:
            raise Closed("It was not opened.")
        with in_use():
            await self._connection.send(text)

    async def receive(self, timeout: float) -> str | bytes:
        """The next message. Raises TimeoutError after `timeout` seconds, and `Closed`."""
        with in_use():
            async with asyncio.timeout(timeout):
                return await self._connection.recv()

    async def close(self) -> None:
        """Close it, if it was opened."""
        await self._ends.aclose()
