"""Commands run in tasks of the service, not of the request: a client that vanishes can't cut one in half."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Annotated, Any, TypeVar

from fastapi import Depends

from app.http.parts import Part
from app.http.problems import ApiError

T = TypeVar("T")


class Tasks:
    """Runs what must come to its end, and takes no new command once the service ends."""

    def __init__(self) -> None:
        self.closing = False
        """Whether the service is ending."""
        self._running: set[asyncio.Task[Any]] = set()

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
        return await asyncio.shield(self.spawn(work))

    def spawn(self, work: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run it to its end, whoever waits for that."""
        task = asyncio.create_task(work)
        self._running.add(task)
        task.add_done_callback(self._reap)
        return task

    async def close(self) -> None:
        """Cancel what still runs, and wait for it."""
        remaining = tuple(self._running)
        for task in remaining:
            task.cancel()
        await asyncio.gather(*remaining, return_exceptions=True)

    def _reap(self, task: asyncio.Task[Any]) -> None:
        self._running.discard(task)
        if not task.cancelled():
            task.exception()  # seen: whoever awaited it got it too


TASKS: Part[Tasks] = Part("tasks")
TasksDep = Annotated[Tasks, Depends(TASKS.get)]
