"""How punctual the SYNCs of a trajectory are: our sender's process and a bare loop, at the same moment.

Three axes at 10 ms. Ours is late until the system has the frame, the loop until it is awake. Beside them the
service, idle or under 1,000 status requests/s; and, for the choice that was made, a thread of that service's
process that does nothing but keep time. A machine that takes CPU time away shakes all of them alike, so only
what was measured at the same moment compares.
"""

from __future__ import annotations

import asyncio
import gc
import json
import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

import uvloop

from bench.http_load import Load, check
from bench.machine import cores
from bench.parts import main
from bench.report import Goal, Row
from bench.rig import Rig, rig
from bench.server_process import LATE
from bench.service import RATE, STATUS, percentile
from drivers.bus.base import Beside
from drivers.cyclic.process import ProcessSender
from drivers.cyclic.sender import CyclePlan, Phase, Track

PERIOD = 0.01
LONGER = 4.0
"""How much longer than other measurements one of these is: a hundred cycles a second are few for a p99."""
TRACKS = tuple(Track(0x500 + axis, b"\x0f\x00", 10.0) for axis in range(3))


@dataclass(slots=True)
class Figures:
    """One round's, of one state of the server; milliseconds."""

    ours: dict[float, float] = field(default_factory=dict[float, float])
    bare: list[float] = field(default_factory=list[float])
    thread: list[float] = field(default_factory=list[float])


@contextmanager
def sink() -> Generator[Beside]:
    """Where the set points go."""
    process = subprocess.Popen([sys.executable, "-m", "bench.sink"], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        yield Beside("socketcand", "can0", "127.0.0.1", int(process.stdout.readline()))
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


async def play(way: Beside, seconds: float) -> dict[float, float]:
    """A path of standing rows, sent as a trajectory's are; its lateness by share."""
    rows = [(0.0, 0.0, 0.0)] * round(seconds / PERIOD)
    news = asyncio.Event()
    sender = ProcessSender(CyclePlan(PERIOD, rows[0], TRACKS, 0, len(rows)), way, news.set)
    await sender.open()
    try:
        sender.feed(rows)
        sender.finish()
        sender.go()
        while sender.report.phase in (Phase.READY, Phase.RUNNING):
            news.clear()
            await news.wait()
        if sender.report.phase is not Phase.STANDING:
            raise RuntimeError(sender.report.why)
        return {share: 1000 * sender.report.lateness.share(share) for share in (0.5, 0.99)}
    finally:
        await sender.close()


async def bare(seconds: float) -> list[float]:
    """The delays of a bare loop in a process of its own."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "bench.punctual", str(PERIOD), str(seconds)), stdout=subprocess.PIPE
    )
    said, _ = await process.communicate()
    found: list[float] = json.loads(said)
    return found


async def late(bench: Rig) -> list[float]:
    """The delays of the thread in the server since it was asked last; asked first, it starts."""
    connection = await bench.address.connect()
    found: list[float] = json.loads(check(await connection.send(bench.address.request("GET", LATE))))
    connection.close()
    return found


async def measure_one(bench: Rig, way: Beside, seconds: float) -> Figures:
    """All three at the same moment."""
    await late(bench)
    ours, plain = await asyncio.gather(play(way, seconds), bare(seconds))
    return Figures(ours, plain, await late(bench))


async def measure(rounds: int, seconds: float) -> tuple[list[Figures], list[Figures]]:
    """Each round both states."""
    idle: list[Figures] = []
    loaded: list[Figures] = []
    async with rig() as bench:
        os.sched_setaffinity(0, set(cores()))  # what is started from here may run anywhere, as in life
        with sink() as way:
            gc.disable()
            for _ in range(rounds):
                idle.append(await measure_one(bench, way, LONGER * seconds))
                load = Load(bench.address, STATUS, RATE)
                running = asyncio.create_task(load.run())
                loaded.append(await measure_one(bench, way, LONGER * seconds))
                load.end()
                await running
            gc.enable()
    return idle, loaded


def run(rounds: int, seconds: float) -> list[Row]:
    """See `bench.parts.Part`."""
    idle, loaded = uvloop.run(measure(rounds, seconds))
    rows: list[Row] = []
    for state, figures in (("server idle", idle), ("1,000 requests/s", loaded)):
        ours = [f.ours[0.5] for f in figures]
        rows.append(Row.alone(f"lateness of SYNC, {state}, p50", "ms", ours, Goal(0.2)))
        for name, share in (("p50", 0.5), ("p99", 0.99)):
            peers = [percentile(f.bare, share) for f in figures]
            rows += [
                Row.beside(
                    f"lateness of SYNC, {state}, {name}", "ms",
                    [f.ours[share] for f in figures], peers, "bare clock_nanosleep loop", Goal(1.5),
                ),
                Row.beside(
                    f"a thread of the server, {state}, {name}", "ms",
                    [percentile(f.thread, share) for f in figures], peers, "bare clock_nanosleep loop",
                ),
            ]  # fmt: skip
    return rows


if __name__ == "__main__":
    sys.exit(main(("trajectory",)))
