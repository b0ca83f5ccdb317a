"""What a sender of cyclic set points is told and tells, whether it runs in our event loop or in a process."""

from __future__ import annotations

import enum
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from drivers.bus.frame import Frame
from drivers.cia301 import cob, sync
from drivers.cyclic.pace import Lateness
from drivers.cyclic.playback import Cause, Playback, Row

SYNC_FRAME = Frame(cob.SYNC, sync.encode())
_TARGET = struct.Struct("<i")


@dataclass(frozen=True, slots=True)
class Track:
    """One axis's set point on the wire: a synchronous RPDO of some bytes that stay, then 32 bits."""

    cob_id: int
    head: bytes
    braking: float
    """steps/cycle2: how fast its speed may fall on the way to rest ..."""
    steepest: float = 0.0
    """... where the path itself doesn't change it faster: by this much at most."""


@dataclass(frozen=True, slots=True)
class CyclePlan:
    """What is sent."""

    period: float
    """Seconds from SYNC to SYNC."""
    start: Row
    """Where the axes stand, steps."""
    tracks: tuple[Track, ...]
    reserve: int
    """Rows that coming to rest takes at most; with no more than these left, an under-run begins."""
    capacity: int
    """Rows that may be on their way."""

    def playback(self) -> Playback:
        """The rows of it, none given yet."""
        tracks = self.tracks
        braking, steepest = [track.braking for track in tracks], [track.steepest for track in tracks]
        return Playback(self.start, braking, self.reserve, steepest)


def row_frames(tracks: Sequence[Track], row: Sequence[int]) -> list[Frame]:
    """The RPDOs of a row."""
    return [
        Frame(track.cob_id, track.head + _TARGET.pack(target))
        for track, target in zip(tracks, row, strict=True)
    ]


class Phase(enum.StrEnum):
    """What the sender does."""

    OPENING = "opening"
    READY = "ready"
    RUNNING = "running"
    STANDING = "standing"
    """All is sent, and the last SYNC is a cycle ago: nothing more comes."""
    DEAD = "dead"
    """It ended otherwise: see `Report.why`."""


@dataclass(slots=True)
class Report:
    """What a sender last said of itself."""

    phase: Phase = Phase.OPENING
    cycles: int = 0
    """SYNCs sent."""
    taken: int = 0
    """Rows that lie behind."""
    slips: int = 0
    """Cycles that were late by a whole one or more."""
    cause: Cause = Cause.NONE
    abrupt: bool = False
    """Whether rows ran out before the axes had come to rest."""
    lateness: Lateness = field(default_factory=Lateness)
    """Of the SYNCs."""
    why: str = ""


class CyclicSender(Protocol):
    """Sends a row each cycle: the SYNC at its deadline, and right behind it the rows for the next one.

    So a row counts a whole cycle after it was sent, and its way over the wire shakes nothing. Called from the
    event loop; nothing here waits but `open` and `close`.
    """

    report: Report

    async def open(self) -> None:
        """Get ready. Raises `drivers.errors.BusError`."""
        ...

    def feed(self, rows: Sequence[Row]) -> None:
        """The next rows; no more at a time than `CyclePlan.capacity` less what is on its way."""
        ...

    def finish(self) -> None:
        """These were the last."""
        ...

    def go(self) -> None:
        """Begin: the first SYNC is a cycle away."""
        ...

    def brake(self) -> None:
        """Come to rest on the path, at once. Nothing takes it back."""
        ...

    def cut(self) -> None:
        """Fall silent, now and for good. What waits in a module for its SYNC goes on waiting there."""
        ...

    async def close(self) -> None:
        """Cut it, and wait until it is gone. Idempotent."""
        ...


OnReport = Callable[[], None]
"""Called in the event loop when `report` has news."""
