"""The service as its clients see it: status and stop over HTTP, on a silent bus and on a full one.

The server has a core of its own; the module, the flood and the HTTP client share the other. Status requests
go round the three axes, 1,000/s on a fixed schedule; latencies count from the sending of a request. A stop is
given to an enabled axis at standstill, which gets its halt just as a turning one does; its time ends when
the kernel hands the controlword to the module's socket. In between an empty route of a bare FastAPI
application in the same server is asked.
"""

from __future__ import annotations

import asyncio
import gc
import random
import sys
import time
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import uvloop

from bench.http_load import Load, check
from bench.parts import main
from bench.report import Goal, Row
from bench.rig import Rig, rig
from bench.server_process import EMPTY
from drivers.devices.catalog import Catalog
from drivers.master.ground.timing import Timing
from drivers.master.plan.pdo_plan import PdoPlan

AXES = (0, 1, 2)
STATUS = tuple(f"/api/v1/nodes/1/axes/{axis}" for axis in AXES)
RATE = 1000.0
STOPPING = 4.0
"""How much longer than the other measurements the one of stops is: there are far fewer of them."""
IDLING = 3.0
"""The same for the idle service."""
PAUSE = 0.01
"""Seconds, at most, between a stop and an empty request."""
SETTLING = 0.1
"""Seconds in which the server has taken what was sent to it."""
MASTER = 127
"""The master's node ID, which no axis borrows."""


@dataclass(slots=True)
class Figures:
    """One round's, of one state of the bus; times in milliseconds."""

    status: list[float] = field(default_factory=list[float])
    stop: list[float] = field(default_factory=list[float])
    empty: list[float] = field(default_factory=list[float])
    lost: int = 0
    frames: float = 0.0
    """Frames/s."""
    rate: float = 0.0
    """Status requests/s that were answered."""
    core: float = 0.0
    """The server's CPU time, per cent of a core."""


def percentile(values: Sequence[float], share: float) -> float:
    """The nearest rank."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


async def measure_status(bench: Rig, seconds: float, figures: Figures) -> None:
    """Status requests, and what the bus carried meanwhile."""
    load = Load(bench.address, STATUS, RATE)
    cpu, began = bench.cpu_seconds(), time.monotonic()
    before = bench.module.ask("counts")
    await load.run(seconds)
    took = time.monotonic() - began
    after = bench.module.ask("counts")
    figures.core = 100 * (bench.cpu_seconds() - cpu) / took
    figures.status = [1000 * latency for latency in load.latencies]
    figures.rate = len(load.latencies) / took
    figures.frames = (after["sent"] - before["sent"]) / took


async def measure_stops(bench: Rig, seconds: float, figures: Figures) -> None:
    """Stops and empty requests in turn, each axis by itself."""
    bench.module.ask("halts")
    given: list[tuple[int, int]] = []

    async def stop_one(axis: int, end: float) -> None:
        stop = bench.address.request("POST", f"/api/v1/nodes/1/axes/{axis}/stop")
        empty = bench.address.request("GET", EMPTY)
        connection = await bench.address.connect()
        while time.monotonic() < end:
            given.append((axis, time.time_ns()))
            check(await connection.send(stop))
            await asyncio.sleep(random.uniform(0, PAUSE))
            began = time.perf_counter()
            check(await connection.send(empty))
            figures.empty.append(1000 * (time.perf_counter() - began))
            await asyncio.sleep(random.uniform(0, PAUSE))
        connection.close()

    end = time.monotonic() + seconds
    await asyncio.gather(*(stop_one(axis, end) for axis in AXES))
    halts = bench.module.ask("halts")
    identifiers = power_identifiers()
    for axis, began in given:
        arrived = min(at for identifier, at in halts if identifier == identifiers[axis] and at > began)
        figures.stop.append((arrived - began) / 1e6)


def power_identifiers() -> list[int]:
    """The COB-ID that carries each axis's controlword to a drive that has no mode."""
    profile = Catalog.load().profile("TMCM-3216")
    plan = PdoPlan.make({1: profile}, MASTER, Timing())
    return [axis.power.cob_id for axis in plan.nodes[1].axes]


@asynccontextmanager
async def full_bus(bench: Rig, figures: Figures) -> AsyncGenerator[None]:
    """A flood, and whether each of its frames was received."""

    async def lost() -> int:
        while True:  # until nothing was under way while we counted
            await asyncio.sleep(SETTLING)
            counts, bus = bench.module.ask("counts"), await bench.get("/api/v1/bus")
            if bench.module.ask("counts") == counts:
                return counts["sent"] + counts["refused"] - bus["counters"]["received"]

    before = await lost()
    bench.module.ask("flood")
    try:
        yield
    finally:
        bench.module.ask("quiet")
    figures.lost = await lost() - before


async def measure(
    rounds: int, seconds: float
) -> tuple[list[Figures], list[Figures], list[tuple[float, float]]]:
    """Rounds on a silent bus, on a full one, and idle, in turn."""
    silent: list[Figures] = []
    full: list[Figures] = []
    idle: list[tuple[float, float]] = []
    async with rig() as bench:
        gc.freeze()
        gc.disable()
        for axis in AXES:
            await bench.post(f"/api/v1/nodes/1/axes/{axis}/enable")
        await Load(bench.address, STATUS, RATE).run(min(1.0, seconds))
        for _ in range(rounds):
            quiet, loaded = Figures(), Figures()
            await measure_status(bench, seconds, quiet)
            async with full_bus(bench, loaded):
                await measure_status(bench, seconds, loaded)
            await measure_stops(bench, STOPPING * seconds, quiet)
            load = Load(bench.address, STATUS, RATE)
            async with full_bus(bench, loaded):
                running = asyncio.create_task(load.run())
                await measure_stops(bench, STOPPING * seconds, loaded)
                load.end()
                await running
            silent.append(quiet)
            full.append(loaded)
            idle.append(await measure_idle(bench, seconds))
        gc.enable()
    return silent, full, idle


async def measure_idle(bench: Rig, seconds: float) -> tuple[float, float]:
    """Per cent of a core, and MiB."""
    cpu, began = bench.cpu_seconds(), time.monotonic()
    await asyncio.sleep(IDLING * seconds)
    share = 100 * (bench.cpu_seconds() - cpu) / (time.monotonic() - began)
    return share, bench.resident_mib()


def run(rounds: int, seconds: float) -> list[Row]:
    """See `bench.parts.Part`."""
    silent, full, idle = uvloop.run(measure(rounds, seconds))
    rows = [
        Row.alone("frames/s on the full bus", "1/s", [f.frames for f in full]),
        Row.alone("of them lost", "frames", [f.lost for f in full], Goal(0)),
        Row.beside(
            "status requests answered at 1,000/s, full bus", "1/s",
            [f.rate for f in full], [f.rate for f in silent], "silent bus",
        ),
        Row.beside(
            "CPU of the server meanwhile", "% of a core",
            [f.core for f in full], [f.core for f in silent], "silent bus",
        ),
    ]  # fmt: skip
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        rows.append(
            Row.beside(
                f"status request, full bus, {name}", "ms",
                [percentile(f.status, share) for f in full],
                [percentile(f.status, share) for f in silent],
                "silent bus", Goal(1.5),
            )
        )  # fmt: skip
    for state, figures in (("silent bus", silent), ("full bus and 1,000 requests/s", full)):
        for name, share in (("p50", 0.5), ("p99", 0.99)):
            rows.append(
                Row.beside(
                    f"stop to controlword, {state}, {name}", "ms",
                    [percentile(f.stop, share) for f in figures],
                    [percentile(f.empty, share) for f in figures],
                    "empty route", Goal(1.5),
                )
            )  # fmt: skip
    return [
        *rows,
        Row.alone("idle service, CPU", "% of a core", [cpu for cpu, _ in idle], Goal(1)),
        Row.alone("idle service, resident", "MiB", [memory for _, memory in idle], Goal(120)),
    ]


if __name__ == "__main__":
    sys.exit(main(("service",)))
