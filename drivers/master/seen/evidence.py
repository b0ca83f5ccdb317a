"""What was seen of the axes while something was under way: enough to tell afterwards what really happened."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.master.ground.where import AxisId
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.status import AxisStatus

Look = Callable[[], Mapping[AxisId, AxisStatus]]
"""Says how each of the axes is at this moment."""

HEAD = 32
"""Changes of the statusword that are kept from the beginning ..."""
TAIL = 32
"""... and up to the end; what lies between is counted only."""
EMERGENCIES = 16
"""Emergencies that are kept; the first ones tell the cause."""


@dataclass(frozen=True, slots=True)
class Sight:
    """A statusword that differed from the one before."""

    axis: AxisId
    after_s: float
    """Seconds since the beginning."""
    statusword: int
    position: int | None
    """6064h, steps, at that moment."""


@dataclass(slots=True)
class Track:
    """One axis's way. All in steps; None where it was not known."""

    axis: AxisId
    start: int | None
    target: int | None = None
    end: int | None = None


class Evidence:
    """Collected by whoever drives the axes. Bounded, whatever the drives do."""

    def __init__(self, look: Look) -> None:
        self._look = look
        self._born = asyncio.get_running_loop().time()
        now = look()
        self.tracks = {axis: Track(axis, status.position) for axis, status in now.items()}
        self.emergencies: list[EmergencyRecord] = []
        self.left_out = 0
        """Changes of a statusword that were seen, but are not kept."""
        self._head: list[Sight] = []
        self._tail: deque[Sight] = deque(maxlen=TAIL)
        self._last: dict[AxisId, int] = {}
        for axis, status in now.items():
            self.see(axis, status)

    @property
    def trail(self) -> tuple[Sight, ...]:
        """The changes of the statuswords, oldest first."""
        return (*self._head, *self._tail)

    def see(self, axis: AxisId, status: AxisStatus) -> None:
        """A status came."""
        if self._last.get(axis) == status.statusword:
            return
        self._last[axis] = status.statusword
        after = asyncio.get_running_loop().time() - self._born
        sight = Sight(axis, after, status.statusword, status.position)
        if len(self._head) < HEAD:
            self._head.append(sight)
            return
        self.left_out += len(self._tail) == TAIL
        self._tail.append(sight)

    def note(self, record: EmergencyRecord) -> None:
        """An emergency came."""
        if len(self.emergencies) < EMERGENCIES:
            self.emergencies.append(record)

    def aim(self, axis: AxisId, target: int) -> None:
        """Where the axis is sent, steps."""
        self.tracks[axis].target = target

    def end(self) -> None:
        """It is over: where the axes are now."""
        for axis, status in self._look().items():
            self.tracks[axis].end = status.position
