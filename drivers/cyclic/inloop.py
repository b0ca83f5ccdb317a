"""A sender in the event loop: for a wire that can't be opened twice, and for virtual clocks.

It is as punctual as the loop: several milliseconds late where the loop is busy.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from drivers.bus.frame import Frame
from drivers.cyclic.pace import Pace
from drivers.cyclic.playback import Cause, Row
from drivers.cyclic.sender import SYNC_FRAME, CyclePlan, OnReport, Phase, Report, row_frames
from drivers.errors import BusError


class LoopSender:
    """See `drivers.cyclic.sender.CyclicSender`."""

    def __init__(self, plan: CyclePlan, send: Callable[[Frame], None], on_report: OnReport) -> None:
        self._plan = plan
        self._send = send
        self._on_report = on_report
        self._playback = plan.playback()
        self._pace: Pace | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._ending = False
        self.report = Report()

    async def open(self) -> None:
        """See `CyclicSender.open`."""
        self._tell(Phase.READY)

    def feed(self, rows: Sequence[Row]) -> None:
        """See `CyclicSender.feed`."""
        self._playback.feed(rows)

    def finish(self) -> None:
        """See `CyclicSender.finish`."""
        self._playback.finish()

    def go(self) -> None:
        """See `CyclicSender.go`."""
        now = asyncio.get_running_loop().time()
        self._pace = Pace(self._plan.period, now + self._plan.period)
        self.report.lateness = self._pace.lateness
        self._tell(Phase.RUNNING)
        if self._prepare():
            self._next()

    def brake(self) -> None:
        """See `CyclicSender.brake`."""
        self._playback.brake(Cause.ASKED)

    def cut(self) -> None:
        """See `CyclicSender.cut`."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self.report.phase is not Phase.STANDING:
            self._tell(Phase.DEAD, "It was cut.")

    async def close(self) -> None:
        """See `CyclicSender.close`."""
        self.cut()

    def _next(self) -> None:
        assert self._pace is not None
        self._timer = asyncio.get_running_loop().call_at(self._pace.due, self._cycle)

    def _cycle(self) -> None:
        """The SYNC, then the rows for the next one."""
        assert self._pace is not None
        self._timer = None
        if self._ending:
            self._tell(Phase.STANDING)
            return
        try:
            self._send(SYNC_FRAME)
        except BusError as error:
            self._tell(Phase.DEAD, error.message)
            return
        self._pace.begun(asyncio.get_running_loop().time())
        self.report.cycles, self.report.slips = self._pace.met, self._pace.slips
        if self._prepare():
            self._tell(Phase.RUNNING)
            self._next()

    def _prepare(self) -> bool:
        """Send the next row. False if the wire doesn't take it."""
        row = self._playback.next()
        self.report.taken = self._playback.taken
        self.report.cause, self.report.abrupt = self._playback.cause, self._playback.abrupt
        if row is None:
            self._ending = True
            return True
        try:
            for frame in row_frames(self._plan.tracks, row):
                self._send(frame)
        except BusError as error:
            self._tell(Phase.DEAD, error.message)
            return False
        return True

    def _tell(self, phase: Phase, why: str = "") -> None:
        if self.report.phase not in (Phase.STANDING, Phase.DEAD):
            self.report.phase, self.report.why = phase, why
            self._on_report()
