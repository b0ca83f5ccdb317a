"""Two ways to read a wire in batches: watched by the event loop, or by one thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Sequence
from typing import Protocol

from drivers.bus.frame import Frame

BATCH = 256
"""Frames taken at most at one wake-up, so that a flood leaves the loop its turn."""
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

    def look_for_end(self) -> None:
        """Raise `Lost` if the other side ended the connection. Asked when nothing is left to receive."""
        ...


OnFrames = Callable[[Sequence[Frame]], None]
OnLost = Callable[[str], None]


class Reader(Protocol):
    """Hands over batches in the event loop, and then, at most once, that the wire is lost."""

    overrun: int
    """Frames dropped because the loop was too busy to take them."""

    def stop(self) -> None:
        """Hand over nothing more. Called in the loop's thread."""
        ...


class DescriptorReader:
    """Drains the source whenever the event loop sees that its descriptor is readable.

    Raises `NotImplementedError` where the loop can't watch descriptors.
    """

    def __init__(self, source: Source, descriptor: int, on_frames: OnFrames, on_lost: OnLost) -> None:
        self.overrun = 0
        self._source = source
        self._descriptor = descriptor
        self._on_frames = on_frames
        self._on_lost = on_lost
        self._stopped = False
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(descriptor, self._readable)

    def stop(self) -> None:
        """See `Reader.stop`."""
        if not self._stopped:
            self._stopped = True
            self._loop.remove_reader(self._descriptor)

    def _readable(self) -> None:
        if self._stopped:
            return
        batch: list[Frame] = []
        lost: Lost | None = None
        try:
            while len(batch) < BATCH:
                frame = self._source.receive(0)
                if frame is None:
                    self._source.look_for_end()
                    break
                batch.append(frame)
        except Lost as error:
            lost = error
        if len(batch) == BATCH:
            # The source may have buffered more than the descriptor shows.
            self._loop.call_soon(self._readable)
        if batch:
            self._on_frames(batch)
        if lost is not None and not self._stopped:
            self._on_lost(str(lost))


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
