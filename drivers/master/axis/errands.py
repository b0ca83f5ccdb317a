"""What an axis is doing: at most one thing at a time, in a task of its own that no client's fate can end."""

from __future__ import annotations

import asyncio
import enum
from collections.abc import Callable, Coroutine
from dataclasses import dataclass

from drivers.errors import CanaxisError


class ErrandName(enum.StrEnum):
    """What an axis can be busy with; reads after "is"."""

    ENABLING = "being enabled"
    DISABLING = "being disabled"
    RESETTING = "resetting its fault"
    STOPPING = "being stopped"
    QUICK_STOPPING = "being quick-stopped"
    MOVING = "moving"
    TURNING = "changing its velocity"
    HOMING = "homing"
    SETTING_POSITION = "having its position set"
    JOGGING = "being jogged"
    FOLLOWING = "following a trajectory"


COMING_TO_REST = frozenset({ErrandName.STOPPING, ErrandName.QUICK_STOPPING, ErrandName.DISABLING})
"""Errands that end at standstill and that a stop therefore joins."""
MOTIONS = frozenset(
    {
        ErrandName.MOVING,
        ErrandName.TURNING,
        ErrandName.HOMING,
        ErrandName.SETTING_POSITION,
        ErrandName.JOGGING,
    }
)
"""Errands that carry out a motion."""


@dataclass(slots=True, eq=False)
class Errand:
    """One of them."""

    name: ErrandName
    task: asyncio.Task[None]
    ended_by: CanaxisError | None = None
    """Why it was abandoned."""

    async def join(self) -> None:
        """Wait for its end; raises what it raised, or why it was abandoned.

        Cancelling the waiting changes nothing.
        """
        try:
            await asyncio.shield(self.task)
        except asyncio.CancelledError:
            current = asyncio.current_task()
            if self.task.cancelled() and self.ended_by is not None and not (current and current.cancelling()):
                raise self.ended_by from None
            raise


class Errands:
    """The one place that starts and ends an axis's tasks. An unexpected exception in one goes to `on_bug`."""

    def __init__(self, label: str, on_bug: Callable[[BaseException], None]) -> None:
        self._label = label
        self._on_bug = on_bug
        self._tasks: set[asyncio.Task[None]] = set()
        self._current: Errand | None = None

    @property
    def current(self) -> Errand | None:
        """What runs now. A task that has ended is none, though its callback may still be under way."""
        errand = self._current
        return None if errand is None or errand.task.done() else errand

    def begin(self, name: ErrandName, work: Coroutine[object, object, None]) -> Errand:
        """Start an errand; none may be running."""
        assert self.current is None, "an axis does one thing at a time"
        task = asyncio.get_running_loop().create_task(work, name=f"{self._label}: {name}")
        errand = Errand(name, task)
        self._tasks.add(task)
        task.add_done_callback(lambda _: self._ended(errand))
        self._current = errand
        return errand

    def release(self, errand: Errand | None) -> None:
        """The errand has nothing more to do with the axis: another may begin while its task ends."""
        if self._current is errand:
            self._current = None

    def abandon(self, error: CanaxisError) -> None:
        """End what runs, if anything; whoever waits for it gets `error`."""
        errand, self._current = self.current, None
        if errand is not None:
            errand.ended_by = error
            errand.task.cancel()

    async def close(self, error: CanaxisError) -> None:
        """Abandon what runs and wait until every task is gone."""
        self.abandon(error)
        if self._tasks:
            await asyncio.wait(tuple(self._tasks))

    def _ended(self, errand: Errand) -> None:
        self._tasks.discard(errand.task)
        if self._current is errand:
            self._current = None
        if not errand.task.cancelled():
            error = errand.task.exception()
            if error is not None and not isinstance(error, CanaxisError):
                self._on_bug(error)
