"""Two ways to read a wire in batches: watched by the event loop, or by one thread."""

from __future__ import annotations

import asyncio
import math
import threading
from collections.abc import Callable, Sequence
from typing import Protocol

from drivers.bus.frame import Frame

BATCH = 256
"""Frames taken at most at one wake-up, so that a flood leaves the loop its turn."""
REST = (0.001, 0.008)
"""Seconds, at least and at most, between two looks while frames stream in."""
WORTH = 24
"""Frames that a look at a stream should find; the rest before it is chosen accordingly."""
STREAM = 0.002
"""Frames that follow each other within so many seconds are a stream."""
HURRY = 0.003
"""Seconds after something was sent in which nothing that arrives waits for the next look."""
OVERRUN = 16_384
"""Frames that a reader thread holds at most while the loop is busy; more are dropped and counted."""
WAITING = 0.1
"""Seconds for which the thread waits at a time; so long it may take to end."""


class Lost(Exception):
    """The interface or its server is gone; the text says how."""


class Source(Protocol):
    """What can be read."""

    def receive(self, timeout: float) -> Frame | None:
        """One frame, or None if none came within `timeout` seconds. Raises `Lost`."""
        ...

    def drain(self, into: list[Frame], limit: int) -> None:
        """Append the frames that are here, at most `limit` of them. Never waits.

        Raises `Lost`, after appending what came before, also if the other side ended the connection.
        """
        ...


OnFrames = Callable[[Sequence[Frame]], None]
OnLost = Callable[[str], None]


class Reader(Protocol):
    """Hands over batches in the event loop, and then, at most once, that the wire is lost."""

    overrun: int
    """Frames dropped because the loop was too busy to take them."""

    def expect_answer(self) -> None:
        """Something was sent: for a while, hand over at once what arrives."""
        ...

    def stop(self) -> None:
        """Hand over nothing more. Called in the loop's thread."""
        ...


class DescriptorReader:
    """Drains the source when its descriptor is readable, but rests between two looks at a stream.

    A wake-up costs the loop as much as several frames, so each should find several. A frame that comes alone,
    or within `HURRY` after something was sent, is handed over at once: an answer never waits.

    `shows_all` says that the descriptor is readable whenever a frame waits: then the answer to what was sent
    is taken without asking for a second frame, which would nearly always be in vain.

    Raises `NotImplementedError` where the loop can't watch descriptors.
    """

    def __init__(
        self,
        source: Source,
        descriptor: int,
        on_frames: OnFrames,
        on_lost: OnLost,
        *,
        shows_all: bool = False,
    ) -> None:
        self.overrun = 0
        self._source = source
        self._descriptor = descriptor
        self._shows_all = shows_all
        self._on_frames = on_frames
        self._on_lost = on_lost
        self._stopped = False
        self._watching = False
        self._next_look: asyncio.TimerHandle | None = None
        self._rest = REST[0]
        self._found_at = -math.inf
        self._hurried_until = -math.inf
        self._awaits_one = False
        """Whether the next look is for one frame, the answer to what was sent."""
        self._loop = asyncio.get_running_loop()
        self._watch()

    def expect_answer(self) -> None:
        """See `Reader.expect_answer`."""
        self._hurried_until = self._loop.time() + HURRY
        self._awaits_one = self._shows_all
        if self._next_look is not None:
            self._watch()

    def stop(self) -> None:
        """See `Reader.stop`."""
        if not self._stopped:
            self._unwatch()
            self._stopped = True

    def _look(self) -> None:
        if self._stopped:
            return
        batch: list[Frame] = []
        lost: Lost | None = None
        limit = 1 if self._awaits_one else BATCH
        self._awaits_one = False
        try:
            self._source.drain(batch, limit)
        except Lost as error:
            lost = error
        self._plan(len(batch))
        if batch:
            self._on_frames(batch)
        if lost is not None and not self._stopped:
            self._on_lost(str(lost))

    def _plan(self, found: int) -> None:
        """Choose what brings the next look."""
        now = self._loop.time()
        if self._watching:
            streaming = found > 0 and now - self._found_at <= STREAM
            self._rest = REST[0]
        else:
            streaming = found > 1
            self._rest = min(max(self._rest * WORTH / max(1, found), REST[0]), REST[1])
        if found:
            self._found_at = now
        if found == BATCH:  # the source may have buffered more than the descriptor shows
            self._loop.call_soon(self._look)
        elif streaming and now >= self._hurried_until:
            self._unwatch()
            self._next_look = self._loop.call_later(self._rest, self._look)
        else:
            self._watch()

    def _watch(self) -> None:
        """Look when the descriptor is readable."""
        if self._next_look is not None:
            self._next_look.cancel()
            self._next_look = None
        if not self._watching:
            self._loop.add_reader(self._descriptor, self._look)
            self._watching = True

    def _unwatch(self) -> None:
        """Don't look, whatever arrives."""
        if self._next_look is not None:
            self._next_look.cancel()
            self._next_look = None
        if self._watching:
            self._loop.remove_reader(self._descriptor)
            self._watching = False


class ThreadReader:
    """Reads in a thread of its own, and hands over what has gathered whenever the loop comes to it."""

    def __init__(self, source: Source, on_frames: OnFrames, on_lost: OnLost) -> None:
        self.overrun = 0
        self._source = source
        self._on_frames = on_frames
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self._gathered: list[Frame] = []
        self._announced = False
        self._lost: Lost | None = None
        self._thread = threading.Thread(target=self._read, name="can reader", daemon=True)
        self._thread.start()

    def expect_answer(self) -> None:
        """See `Reader.expect_answer`: the thread never lets anything wait."""

    def stop(self) -> None:
        """See `Reader.stop`. The thread ends within `WAITING`."""
        self._stopped.set()

    def _read(self) -> None:
        while not self._stopped.is_set():
            try:
                frame = self._source.receive(WAITING)
            except Lost as error:
                self._lost = error
                self._announce(None)
                return
            if frame is not None:
                self._announce(frame)

    def _announce(self, frame: Frame | None) -> None:
        """Let the loop know; one hand-over waits at a time, however much gathers until it comes."""
        with self._lock:
            if frame is not None:
                if len(self._gathered) >= OVERRUN:
                    self.overrun += 1
                    return
                self._gathered.append(frame)
            if self._announced:
                return
            self._announced = True
        try:
            self._loop.call_soon_threadsafe(self._hand_over)
        except RuntimeError:  # the loop was closed without us
            self._stopped.set()

    def _hand_over(self) -> None:
        with self._lock:
            batch = self._gathered[:BATCH]
            del self._gathered[:BATCH]
            self._announced = bool(self._gathered)
            lost = self._lost if not self._gathered else None
        if self._announced:
            self._loop.call_soon(self._hand_over)
        if self._stopped.is_set():
            return
        if batch:
            self._on_frames(batch)
        if lost is not None and not self._stopped.is_set():
            self._stopped.set()
            self._on_lost(str(lost))
