"""The sender as a process of its own, started by `drivers.cyclic.process`.

It holds no lock that anybody else wants, allocates little and collects no garbage, sleeps until shortly
before each deadline and waits the rest out awake. Real-time priority is taken where the system grants it
(`RLIMIT_RTPRIO`), and not missed where it doesn't. When its standard input closes, whoever gave the rows is
gone: it comes to rest on the path with the rows that it has, and ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import select
import sys
import time

from drivers.bus.beside import Door, open_beside
from drivers.cyclic import messages
from drivers.cyclic.messages import Inbox
from drivers.cyclic.pace import Pace
from drivers.cyclic.playback import Cause
from drivers.cyclic.sender import SYNC_FRAME, CyclePlan, Phase, Report, row_frames
from drivers.errors import BusError

REPORT_EACH = 0.05
"""Seconds between two reports."""
AWAKE = 150e-6
"""Seconds before a deadline that are waited out awake; a fiftieth of a short cycle."""
PRIORITY = 50
"""SCHED_FIFO, where it is granted."""
_PR_SET_TIMERSLACK = 29


class _Child:
    """One path, from its plan to its end."""

    def __init__(self, plan: CyclePlan, door: Door) -> None:
        self._plan = plan
        self._door = door
        self._playback = plan.playback()
        self._inbox = Inbox()
        self._orphaned = False
        self._going = False
        self.report = Report(Phase.READY)

    def run(self) -> None:
        """Wait for the word, then send until the end. Raises `BusError`."""
        self._say()
        while not self._going:
            if self._orphaned:
                return
            select.select([0], [], [], REPORT_EACH)
            self._listen()
            self._door.drain()
        self._cycle()

    def _cycle(self) -> None:
        period = self._plan.period
        awake = min(AWAKE, period / 50)
        pace = Pace(period, time.monotonic() + period)
        report = self.report
        report.phase, report.lateness = Phase.RUNNING, pace.lateness
        told = 0.0
        quickest = 0.0
        ended = not self._prepare()
        while True:
            _wait_until(pace.due - quickest, awake)
            if ended:
                break
            begun = time.monotonic()
            self._door.send((SYNC_FRAME,))
            now = time.monotonic()
            # So the system has the frame at the deadline, and never before.
            quickest = min(quickest or now - begun, now - begun)
            pace.begun(now)
            report.cycles, report.slips = pace.met, pace.slips
            ended = not self._prepare()
            self._listen()
            self._door.drain()
            if now - told >= REPORT_EACH:
                told = now
                self._say()
        report.phase = Phase.STANDING
        self._say(whole=True)

    def _prepare(self) -> bool:
        row = self._playback.next()
        report, playback = self.report, self._playback
        report.taken, report.cause, report.abrupt = playback.taken, playback.cause, playback.abrupt
        if row is None:
            return False
        self._door.send(row_frames(self._plan.tracks, row))
        return True

    def _listen(self) -> None:
        """Take what was said meanwhile."""
        while not self._orphaned:
            try:
                piece = os.read(0, 65_536)
            except BlockingIOError:
                return
            if not piece:
                self._orphaned = True
                self._playback.brake(Cause.ORPHANED)
                return
            for kind, payload in self._inbox.take(piece):
                self._heed(kind, payload)

    def _heed(self, kind: bytes, payload: bytes) -> None:
        if kind == messages.ROWS:
            self._playback.feed(messages.unpack_rows(payload, len(self._plan.tracks)))
        elif kind == messages.FINISH:
            self._playback.finish()
        elif kind == messages.GO:
            self._going = True
        elif kind == messages.BRAKE:
            self._playback.brake(Cause.ASKED)

    def _say(self, *, whole: bool = False) -> None:
        _write(messages.pack_report(self.report, whole=whole), patient=whole)


def _write(line: bytes, *, patient: bool) -> None:
    """Say something, unless nobody listens; only the last word is worth waiting for."""
    if patient:
        os.set_blocking(1, True)
    with contextlib.suppress(BlockingIOError, BrokenPipeError):
        os.write(1, line)


def _wait_until(due: float, awake: float) -> None:
    left = due - time.monotonic() - awake
    if left > 0:
        time.sleep(left)
    while time.monotonic() < due:
        pass


def _be_punctual() -> None:
    """As far as the system lets us."""
    gc.collect()
    gc.freeze()
    gc.disable()
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def _read_line() -> bytes:
    line = bytearray()
    while not line.endswith(b"\n"):
        piece = os.read(0, 1)
        if not piece:
            raise EOFError
        line += piece
    return bytes(line)


def main() -> int:
    """Read the plan, open the wire, send."""
    try:
        plan, way = messages.unpack_plan(_read_line())
    except EOFError:
        return 0
    report = Report(Phase.DEAD)
    try:
        door = open_beside(way)
        try:
            os.set_blocking(0, False)
            os.set_blocking(1, False)
            child = _Child(plan, door)
            report = child.report
            _be_punctual()
            child.run()
        finally:
            door.close()
    except BusError as error:
        report.phase, report.why = Phase.DEAD, error.message
        _write(messages.pack_report(report, whole=True), patient=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
