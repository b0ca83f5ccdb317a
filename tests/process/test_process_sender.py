"""The sender's process by itself: what it puts on the wire, and what it does when nobody is left."""

from __future__ import annotations

import asyncio
import itertools
import re
import signal

import pytest

from drivers.bus.base import Beside
from drivers.cyclic.playback import Cause
from drivers.cyclic.process import ProcessSender
from drivers.cyclic.sender import CyclePlan, Phase, Track

pytestmark = [pytest.mark.process, pytest.mark.timeout(60)]

SPEED, BRAKING = 20.0, 1.0
"""Steps, and steps less, a cycle."""
ROWS, RESERVE = 1000, 20


class Wire:
    """A socketcand server that keeps what it is sent."""

    def __init__(self) -> None:
        self.text = ""
        self.gone = asyncio.Event()
        self.came = asyncio.Condition()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"< hi >")
        while piece := await reader.read(4096):
            self.text += piece.decode("ascii")
            if b"open" in piece or b"rawmode" in piece:
                writer.write(b"< ok >")
            async with self.came:
                self.came.notify_all()
        self.gone.set()
        writer.close()

    @property
    def targets(self) -> list[int]:
        found = re.findall(r"< send 500 6 0f 00 (.{11}) >", self.text)
        return [int.from_bytes(bytes.fromhex(data), "little", signed=True) for data in found]

    async def until(self, number: int) -> None:
        async with self.came:
            await self.came.wait_for(lambda: len(self.targets) >= number)


async def started(wire: Wire, port: int) -> ProcessSender:
    plan = CyclePlan(0.005, (0.0,), (Track(0x500, b"\x0f\x00", BRAKING),), RESERVE, ROWS)
    sender = ProcessSender(plan, Beside("socketcand", "can0", "127.0.0.1", port), lambda: None)
    await sender.open()
    speeds = [min(SPEED, number * BRAKING) for number in range(1, ROWS + 1)]
    sender.feed([(place,) for place in itertools.accumulate(speeds)])
    sender.go()
    return sender


async def test_a_sender_whose_service_died_comes_to_rest_on_the_path_and_ends() -> None:
    wire = Wire()
    server = await asyncio.start_server(wire.serve, "127.0.0.1", 0)
    async with server:
        sender = await started(wire, server.sockets[0].getsockname()[1])
        await wire.until(60)
        process = sender._process
        assert process is not None
        assert process.stdin is not None
        process.stdin.close()  # as the end of the service does
        assert await process.wait() == 0
        await wire.gone.wait()
        assert sender._listener is not None
        await sender._listener
        report = sender.report
        await sender.close()
    targets = wire.targets
    assert (report.phase, report.cause) == (Phase.STANDING, Cause.ORPHANED), "not because rows ran out"
    assert len(targets) > 60
    changes = [b - a for a, b in itertools.pairwise(targets)]
    assert max(changes) == SPEED
    assert changes[-1] <= BRAKING + 1, "at rest"
    assert max(a - b for a, b in itertools.pairwise(changes)) <= BRAKING + 1, "rounding, no jerk"
    assert wire.text.count("< send 080 0  >") == len(targets), "each with its SYNC"


async def test_a_sender_that_is_cut_says_no_more_whatever_state_it_is_in() -> None:
    wire = Wire()
    server = await asyncio.start_server(wire.serve, "127.0.0.1", 0)
    async with server:
        sender = await started(wire, server.sockets[0].getsockname()[1])
        await wire.until(20)
        process = sender._process
        assert process is not None
        process.send_signal(signal.SIGSTOP)
        sender.cut()
        assert sender.report.phase is Phase.DEAD
        await wire.gone.wait()
        await sender.close()
    assert process.returncode == -signal.SIGKILL
