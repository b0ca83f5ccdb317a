"""What waits for one node's SDO channel: bounded, the urgent first, and equal reads as one."""

from __future__ import annotations

import asyncio
import enum
import itertools
import math
from bisect import insort
from collections.abc import Iterator
from typing import NamedTuple

from drivers.cia301.sdo import SdoTransfer, SdoUpload

SIZE = 64
"""Transfers that may wait for one node: two seconds of a module that takes 30 ms for each."""


class Priority(enum.IntEnum):
    """Who goes first when several wait for the channel; first come, first served within one."""

    STOP = 0
    CONTROL = 1
    CONFIGURE = 2
    MONITOR = 3


class Patience(NamedTuple):
    """Until when a caller waits, on the event loop's clock."""

    turn: float
    """For the request to leave."""
    end: float
    """For the outcome."""

    def until(self, *, begun: bool) -> float:
        """What counts before and after the request has left."""
        return self.end if begun else min(self.turn, self.end)


class Job:
    """One transfer, and everyone who waits for its outcome."""

    __slots__ = ("address", "begun", "ended", "priority", "rank", "transfer", "waiters")

    def __init__(
        self, transfer: SdoTransfer, priority: Priority, waiter: asyncio.Future[bytes], patience: Patience
    ) -> None:
        self.transfer = transfer
        self.address = transfer.address
        """The object."""
        self.priority = priority
        self.rank = 0
        """Its place among those of one priority; the queue gives it."""
        self.waiters = {waiter: patience}
        self.begun = False
        """Whether its request has left."""
        self.ended = False

    @property
    def writes(self) -> bool:
        """Whether it changes the node."""
        return not isinstance(self.transfer, SdoUpload)

    def __str__(self) -> str:
        return f"the {'write' if self.writes else 'read'} of {self.address}"

    @property
    def is_wanted(self) -> bool:
        """Whether anyone still waits: a caller that was cancelled has not yet had its turn to say so."""
        return any(not waiter.done() for waiter in self.waiters)

    @property
    def due(self) -> float:
        """When the first of its callers gives up."""
        begun = self.begun
        return min(patience.until(begun=begun) for patience in self.waiters.values())

    def expired(self, now: float) -> list[asyncio.Future[bytes]]:
        """The callers who wait no longer."""
        begun = self.begun
        return [waiter for waiter, patience in self.waiters.items() if patience.until(begun=begun) <= now]


class SdoQueue:
    """The jobs that have not begun, sorted."""

    def __init__(self, size: int = SIZE) -> None:
        self._size = size
        self._jobs: list[Job] = []
        self._ranks = itertools.count()

    def __len__(self) -> int:
        return len(self._jobs)

    def __iter__(self) -> Iterator[Job]:
        return iter(self._jobs)

    @property
    def foremost(self) -> Job | None:
        """The job to begin next; it stays until `remove`."""
        return self._jobs[0] if self._jobs else None

    def put(self, job: Job) -> Job | None:
        """Let a job wait. Returns the one that there is no room for: the newest of the least urgent.

        That may be `job` itself, or one that it drives out; a stop finds room as long as not all that waits
        are stops.
        """
        job.rank = next(self._ranks)
        insort(self._jobs, job, key=_order)
        return self._jobs.pop() if len(self._jobs) > self._size else None

    def keeps_order(self, job: Job, priority: Priority) -> bool:
        """Whether a read may be joined by a caller of this priority without bringing anyone a value from
        before a write that waits, and that comes first where each has a transfer of its own.
        """
        first = (-1, 0) if job.begun else (min(priority, job.priority), job.rank)
        last = max(_order(job), (priority, math.inf))
        return not any(other.writes and first < _order(other) < last for other in self._jobs)

    def hasten(self, job: Job, priority: Priority) -> None:
        """Someone more urgent waits for it as well."""
        self._jobs.remove(job)
        job.priority = priority
        insort(self._jobs, job, key=_order)

    def remove(self, job: Job) -> None:
        """A job begins, or nobody wants it any more."""
        self._jobs.remove(job)

    def clear(self) -> list[Job]:
        """Take everything out."""
        jobs, self._jobs = self._jobs, []
        return jobs


def _order(job: Job) -> tuple[int, int]:
    return job.priority, job.rank
