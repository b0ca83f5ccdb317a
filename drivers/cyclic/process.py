"""A sender in a process of its own, as the service sees it."""

from __future__ import annotations

import asyncio
import contextlib
from asyncio.subprocess import PIPE, Process
from collections.abc import Sequence

from drivers import program
from drivers.bus.base import Beside
from drivers.cyclic import messages
from drivers.cyclic.playback import Row
from drivers.cyclic.sender import CyclePlan, OnReport, Phase, Report
from drivers.errors import BusDown

OPENING = 15.0
"""Seconds from its start in which the process must have the wire open."""


class ProcessSender:
    """See `drivers.cyclic.sender.CyclicSender`. The wire is opened a second time, by the process."""

    def __init__(self, plan: CyclePlan, way: Beside, on_report: OnReport) -> None:
        self._plan = plan
        self._way = way
        self._on_report = on_report
        self._process: Process | None = None
        self._listener: asyncio.Task[None] | None = None
        self._opened = asyncio.Event()
        self._cut = False
        self.report = Report()

    async def open(self) -> None:
        """See `CyclicSender.open`."""
        try:
            # A session of its own: an interrupt from the terminal is for the service, which stops the axes.
            self._process = await asyncio.create_subprocess_exec(
                *program.command("drivers.cyclic.child"),
                stdin=PIPE,
                stdout=PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise BusDown(f"The sender's process can't be started: {error.strerror or error}") from error
        self._listener = asyncio.create_task(self._listen(self._process), name="trajectory sender")
        self._say(messages.pack_plan(self._plan, self._way))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(OPENING):
                await self._opened.wait()
        if self.report.phase is not Phase.READY:
            raise BusDown(f"The sender's process did not open the wire: {self.report.why or 'no answer'}")

    def feed(self, rows: Sequence[Row]) -> None:
        """See `CyclicSender.feed`."""
        self._say(messages.pack_rows(rows))

    def finish(self) -> None:
        """See `CyclicSender.finish`."""
        self._say(messages.pack(messages.FINISH))

    def go(self) -> None:
        """See `CyclicSender.go`."""
        self._say(messages.pack(messages.GO))

    def brake(self) -> None:
        """See `CyclicSender.brake`."""
        self._say(messages.pack(messages.BRAKE))

    def cut(self) -> None:
        """See `CyclicSender.cut`: the process is killed, once."""
        if self._cut:
            return
        self._cut = True
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
        self._note_dead("It was cut.")

    async def close(self) -> None:
        """See `CyclicSender.close`."""
        self.cut()
        process, listener = self._process, self._listener
        if process is None or listener is None:
            return
        assert process.stdin is not None
        process.stdin.close()
        await process.wait()
        await listener
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            await process.stdin.wait_closed()

    def _say(self, message: bytes) -> None:
        process = self._process
        if process is not None and process.stdin is not None and not process.stdin.is_closing():
            process.stdin.write(message)

    async def _listen(self, process: Process) -> None:
        assert process.stdout is not None
        while line := await process.stdout.readline():
            if self._cut:
                continue
            try:
                self.report = messages.unpack_report(line)
            except (ValueError, KeyError, TypeError):
                continue
            self._opened.set()
            self._on_report()
        self._note_dead("The process of the sender ended.")

    def _note_dead(self, why: str) -> None:
        self._opened.set()
        if self.report.phase not in (Phase.STANDING, Phase.DEAD):
            self.report.phase, self.report.why = Phase.DEAD, why
            self._on_report()
