"""SDO reads: what one costs the master beside its peers, and how many fit when several nodes are read.

All masters talk to one responder in a process of its own, which only copies prepared answers. What counts is
the CPU time of the master's process, all its threads and the kernel's work for it included, for each read of
a 32-bit object as bytes.
"""

from __future__ import annotations

import asyncio
import gc
import multiprocessing
import select
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import ExitStack, asynccontextmanager, contextmanager
from multiprocessing.synchronize import Event
from typing import Final, NamedTuple

import canopen
import canopen_asyncio
import uvloop

from bench.machine import ahead_of_the_rest
from bench.parts import main
from bench.report import Goal, Row
from bench.wire import CAN_FRAME, CHANNEL, as_socketcan, pack, pair
from drivers.bus.pythoncan import PythonCanBus
from drivers.cia301 import cob
from drivers.cia301.objects import Address
from drivers.master.ground.router import Router
from drivers.master.ground.timing import Timing
from drivers.master.link.backbone import Backbone
from drivers.master.plan.configuration import NetworkConfig
from drivers.master.sdo.client import SdoClient

NODES: Final = (1, 8, 32)
ANSWER: Final = 0.001
"""Seconds that a node takes to answer, where several are read at once; a module takes about that."""
ADDRESS: Final = Address(0x6064)
VALUE: Final = bytes.fromhex("78563412")
CHUNK: Final = 20
"""Reads between two looks at the clock."""
SLICE: Final = 0.05
"""Seconds for which one master reads before it is the next one's turn."""

LoopFactory = Callable[[], asyncio.AbstractEventLoop]
LOOPS: Final[dict[str, LoopFactory]] = {"uvloop": uvloop.new_event_loop, "asyncio": asyncio.new_event_loop}
"""The service runs on the first, where it is to be had."""


class Cost(NamedTuple):
    """What some reads cost the master's process."""

    cpu: float
    """Seconds of CPU."""
    reads: int


Measure = Callable[[float], Cost]
"""Reads for so many seconds."""
Upload = Callable[[], Awaitable[bytes]]


class Parallel(NamedTuple):
    """What reading several nodes at once came to."""

    rate: float
    """Reads a second, of all nodes together."""
    cpu: float
    """Seconds of CPU for each read."""
    fairness: float
    """Reads of the slowest node divided by those of the fastest."""


# --- the nodes


def respond(wire: socket.socket, delay: float, ready: Event) -> None:
    """Answer reads of `ADDRESS` by any node, each after `delay` seconds, until the master's end is closed."""
    address = struct.pack("<HB", *ADDRESS)
    read = b"\x40" + address + bytes(4)
    answers = {
        cob.sdo_request(node): pack(cob.sdo_response(node), b"\x43" + address + VALUE)
        for node in range(1, max(NODES) + 1)
    }
    under_way: deque[tuple[float, bytes]] = deque()
    ready.set()
    while True:
        wait = max(0.0, under_way[0][0] - time.monotonic()) if under_way else None
        if select.select((wire,), (), (), wait)[0]:
            raw = wire.recv(72)
            if not raw:
                return
            cob_id, _, data = CAN_FRAME.unpack(raw)
            if data == read and cob_id in answers:
                under_way.append((time.monotonic() + delay, answers[cob_id]))
        while under_way and under_way[0][0] <= time.monotonic():
            wire.send(under_way.popleft()[1])


@contextmanager
def nodes_answering(delay: float = 0.0) -> Iterator[None]:
    """While entered, python-can's `socketcan` opens a wire on which nodes answer."""
    ours, theirs = pair()
    spawning = multiprocessing.get_context("spawn")
    ready = spawning.Event()
    process = spawning.Process(target=respond, args=(theirs, delay, ready), daemon=True)
    process.start()
    ready.wait()
    theirs.close()
    try:
        with as_socketcan(ours):
            yield
    finally:
        ours.close()
        process.join(5)


# --- the masters: each stays open, and reads one object over and over when it is its turn


@contextmanager
def canopen_reading() -> Iterator[Measure]:
    """A thread that waits for python-can's notifier."""
    network = canopen.Network()
    with nodes_answering():
        network.connect(interface="socketcan", channel=CHANNEL)
        try:
            upload = network.add_node(1, canopen.ObjectDictionary()).sdo.upload
            assert upload(*ADDRESS) == VALUE

            def measure(seconds: float) -> Cost:
                reads, end, began = 0, time.monotonic() + seconds, time.process_time()
                while time.monotonic() < end:
                    for _ in range(CHUNK):
                        upload(*ADDRESS)
                    reads += CHUNK
                return Cost(time.process_time() - began, reads)

            yield measure
        finally:
            network.disconnect()


@contextmanager
def canopen_asyncio_reading() -> Iterator[Measure]:
    """Set up as its documentation says."""
    with nodes_answering(), asyncio.Runner() as runner:

        async def open_network() -> tuple[canopen_asyncio.Network, Upload]:
            network = canopen_asyncio.Network(loop=asyncio.get_running_loop())
            network.connect(interface="socketcan", channel=CHANNEL)
            node = await asyncio.to_thread(network.add_node, 1, canopen_asyncio.ObjectDictionary())
            return network, lambda: node.sdo.aupload(*ADDRESS)

        network, upload = runner.run(open_network())
        try:
            yield lambda seconds: runner.run(_keep_reading(upload, seconds))
        finally:
            network.disconnect()


@contextmanager
def canaxis_reading(loop: LoopFactory) -> Iterator[Measure]:
    """Our client, on the bus, backbone and router of the service."""
    with nodes_answering(), asyncio.Runner(loop_factory=loop) as runner:
        opened = clients(1)
        (client,) = runner.run(opened.__aenter__())
        try:
            yield lambda seconds: runner.run(_keep_reading(lambda: client.upload(ADDRESS), seconds))
        finally:
            runner.run(opened.__aexit__(None, None, None))


async def _keep_reading(upload: Upload, seconds: float) -> Cost:
    assert await upload() == VALUE
    reads, end, began = 0, time.monotonic() + seconds, time.process_time()
    while time.monotonic() < end:
        for _ in range(CHUNK):
            await upload()
        reads += CHUNK
    return Cost(time.process_time() - began, reads)


@asynccontextmanager
async def clients(nodes: int) -> AsyncIterator[list[SdoClient]]:
    """An SDO client for each of so many nodes."""

    def fail(bug: BaseException) -> None:
        raise bug

    bus = PythonCanBus("socketcan", CHANNEL)
    backbone = Backbone(bus, NetworkConfig(nodes=()), Timing(), fail)
    router = Router(backbone.counters, fail)
    made = [SdoClient(node, backbone.send) for node in range(1, nodes + 1)]
    for node, client in enumerate(made, start=1):
        router.add(cob.sdo_response(node), client.on_frame)
    unsubscribe = bus.subscribe(router.dispatch)
    await bus.open()
    try:
        yield made
    finally:
        unsubscribe()
        for client in made:
            client.close()
        await bus.close()


def parallel(nodes: int, seconds: float) -> Parallel:
    """Read from `nodes` nodes at once, one after the other from each."""

    async def keep_reading(client: SdoClient, end: float) -> int:
        done = 0
        while time.monotonic() < end:
            await client.upload(ADDRESS)
            done += 1
        return done

    async def measure() -> Parallel:
        async with clients(nodes) as made:
            await asyncio.gather(*(client.upload(ADDRESS) for client in made))
            began, end = time.process_time(), time.monotonic() + seconds
            counts = await asyncio.gather(*(keep_reading(client, end) for client in made))
            cpu = time.process_time() - began
        return Parallel(sum(counts) / seconds, cpu / sum(counts), min(counts) / max(counts))

    with nodes_answering(ANSWER), asyncio.Runner(loop_factory=LOOPS["uvloop"]) as runner:
        return runner.run(measure())


# --- the rows


def run(rounds: int, seconds: float) -> list[Row]:
    """See `bench.parts.Part`."""
    with ahead_of_the_rest():
        return [*_costs(rounds, seconds), *_rates(rounds, seconds)]


def _costs(rounds: int, seconds: float) -> Iterator[Row]:
    goals = {"canopen": Goal(0.35), "canopen-asyncio": Goal(0.2)}
    ours = {f"on {name}": name for name in LOOPS}
    with ExitStack() as opened:
        masters: dict[str, Measure] = {
            "canopen": opened.enter_context(canopen_reading()),
            "canopen-asyncio": opened.enter_context(canopen_asyncio_reading()),
        }
        for title, name in ours.items():
            masters[title] = opened.enter_context(canaxis_reading(LOOPS[name]))
        costs: dict[str, list[float]] = {name: [] for name in masters}
        for _ in range(rounds):
            gc.collect()
            for name, cost in _round(masters, seconds).items():
                costs[name].append(cost.cpu / cost.reads * 1e6)
    for title in ours:
        for peer, goal in goals.items():
            what = f"CPU per expedited SDO read, {title}"
            yield Row.beside(what, "us", costs[title], costs[peer], peer, goal)


def _round(masters: Mapping[str, Measure], seconds: float) -> dict[str, Cost]:
    """What each master costs; they take turns of `SLICE`, so that whatever disturbs disturbs all of them."""
    total = dict.fromkeys(masters, Cost(0.0, 0))
    for _ in range(max(1, round(seconds / SLICE))):
        for name, measure in masters.items():
            cost = measure(SLICE)
            total[name] = Cost(total[name].cpu + cost.cpu, total[name].reads + cost.reads)
    return total


def _rates(rounds: int, seconds: float) -> Iterator[Row]:
    found: dict[int, list[Parallel]] = {nodes: [] for nodes in NODES}
    for _ in range(rounds):
        for nodes, results in found.items():
            gc.collect()
            results.append(parallel(nodes, seconds))
    for nodes, results in found.items():
        what = f"SDO reads, {nodes} node{'s at once' if nodes > 1 else ''}, {ANSWER * 1000:g} ms an answer"
        yield Row.alone(f"{what}: rate of all", "1/s", [one.rate for one in results])
        yield Row.alone(f"{what}: CPU per read", "us", [one.cpu * 1e6 for one in results])
        if nodes > 1:
            yield Row.alone(f"{what}: slowest node over fastest", "", [one.fairness for one in results])


if __name__ == "__main__":
    sys.exit(main(["sdo"]))
