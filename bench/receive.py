"""What a received TPDO costs, from the file descriptor to what a program asks for.

Everyone gets the same frames, from a process that keeps the time, through python-can's `socketcan`
(`bench.wire`), and takes every one of them:

- Canaxis: a `Network` as the service has it, its bus, router and axes; each frame becomes a frozen
  `AxisStatus` with state, position and velocity. A look-out on each axis, such as a waiting command has, sees
  every status and adds up what it says, which is compared with what was sent: nothing is skipped unseen.
- canopen and canopen-asyncio: a callback on each PDO, in which each mapped variable is read as an integer and
  added up in the same way.

The frames are those of three axes in turn: TPDO 2 (position and velocity, eight bytes), and each tenth time
TPDO 1 (statusword, mode, inputs). CPU time is that of this process; the goal counts on uvloop, which the
service runs on.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import socket
import sys
import time
from collections.abc import Callable, Coroutine, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import canopen
import canopen_asyncio
import uvloop

from bench import wire
from bench.machine import ahead_of_the_rest
from bench.pacer import Pacer
from bench.parts import main
from bench.report import Goal, Row
from drivers.bus.pythoncan import PythonCanBus
from drivers.devices.catalog import Catalog
from drivers.master import AxisConfig, AxisStatus, Network, NetworkConfig, NodeConfig
from drivers.master.ground.timing import Timing
from drivers.master.plan.pdo_plan import MOTION_OBJECTS, STATUS_OBJECTS, AxisPdos, PdoPlan

NODE = 1
MODEL = "TMCM-3216"
AXES = 3
EDS = Path(__file__).parents[1] / "drivers/devices/data/tmcm_3216.eds"
STATUS_EVERY = 10
"""One frame in so many is a TPDO 1."""
CYCLE = 30 * STATUS_EVERY * AXES
"""Different frames, sent round and round."""
STATUSWORDS = (0x1637, 0x5237)
"""OPERATION_ENABLED: standing there, and on the way."""
SETTLING = 0.5
"""Seconds that frames under way get after the last was sent."""
RATES = (("a full bus", wire.FULL_BUS), ("3 axes x 1 kHz", 3000))


@dataclass(frozen=True, slots=True)
class Heard:
    """What one side made of the frames."""

    cpu_us: float
    """CPU time of a frame, in microseconds."""
    lost: int
    """Frames that came to nothing."""


@dataclass(slots=True)
class Tally:
    """Frames that were taken, and the sum of what they said."""

    frames: int = 0
    total: int = 0


@dataclass(frozen=True, slots=True)
class Traffic:
    """The frames of one measurement."""

    pdos: Sequence[AxisPdos]
    frames: Sequence[bytes]
    sums: Sequence[int]
    """What each frame adds to the total."""

    @classmethod
    def make(cls) -> Traffic:
        """For one module of three axes."""
        profile = Catalog.load().profile(MODEL)
        pdos = PdoPlan.make({NODE: profile}, 127, Timing()).nodes[NODE].axes
        frames: list[bytes] = []
        sums: list[int] = []
        for number in range(CYCLE):
            turn, axis = divmod(number, AXES)
            if turn % STATUS_EVERY:
                pdo, values = pdos[axis].motion, (1000 * turn - number, 51_200 + number)
            else:
                pdo, values = pdos[axis].status, (STATUSWORDS[turn // STATUS_EVERY % 2], 1, 0)
            frames.append(wire.pack(pdo.cob_id, pdo.mapping.pack(values)))
            sums.append(sum(values))
        return cls(pdos, frames, sums)

    def expected(self, count: int) -> int:
        """The total after `count` frames."""
        rounds, rest = divmod(count, len(self.sums))
        return rounds * sum(self.sums) + sum(self.sums[:rest])


@contextlib.contextmanager
def _paced(traffic: Traffic, count: int, rate: float) -> Generator[tuple[socket.socket, Pacer]]:
    near, far = wire.pair()
    with far, Pacer(far, traffic.frames, count, rate) as pacer:
        yield near, pacer
    near.close()


class Meter:
    """CPU time from `go` on."""

    def __init__(self, traffic: Traffic, pacer: Pacer, tally: Tally, count: int) -> None:
        self._traffic, self._pacer, self._tally, self._count = traffic, pacer, tally, count
        gc.collect()
        self._began = time.process_time()
        pacer.go()

    def ticks(self) -> Iterator[float]:
        """Seconds to sleep before looking again, until all frames are here or late."""
        while not self._pacer.done:
            yield 0.1
        if self._tally.frames < self._count:
            yield SETTLING

    def read(self) -> Heard:
        """What it cost. Raises `AssertionError` if frames were taken, but not rightly."""
        cpu = time.process_time() - self._began
        lost = self._count - self._tally.frames
        assert lost >= self._pacer.refused() >= 0
        assert lost or self._tally.total == self._traffic.expected(self._count)
        return Heard(1e6 * cpu / max(1, self._tally.frames), lost)


class _LookOut:
    """Sees every status of an axis, and is never satisfied."""

    def __init__(self, tally: Tally, first: AxisStatus) -> None:
        self._tally = tally
        self._last = first

    def see(self, status: AxisStatus) -> bool:
        """Add up what is new: every frame brings another motion, or another statusword."""
        last, self._last = self._last, status
        tally = self._tally
        if status.position != last.position or status.velocity != last.velocity:
            assert status.position is not None
            assert status.velocity is not None
            tally.total += status.position + status.velocity
        elif status.statusword != last.statusword:
            tally.total += status.statusword + status.mode
            assert status.state is not None
        else:
            return False  # it grew stale, or is the one that `until` looks at first
        tally.frames += 1
        return False


async def _canaxis(traffic: Traffic, count: int, rate: float) -> Heard:
    axes = tuple(AxisConfig(name=name) for name in "xyz")
    config = NetworkConfig(nodes=(NodeConfig(node_id=NODE, name="stage", model=MODEL, axes=axes),))
    tally = Tally()
    with _paced(traffic, count, rate) as (near, pacer), wire.as_socketcan(near):
        network = Network(PythonCanBus("socketcan", wire.CHANNEL), config, Catalog.load())
        async with network:
            drives = [axis._drive for axis in network.node(NODE).axes]
            look_outs = [
                asyncio.create_task(drive.until(_LookOut(tally, drive.status).see, 3600)) for drive in drives
            ]
            await asyncio.sleep(0)
            meter = Meter(traffic, pacer, tally, count)
            for pause in meter.ticks():
                await asyncio.sleep(pause)
            heard = meter.read()
            for look_out in look_outs:
                look_out.cancel()
            await asyncio.gather(*look_outs, return_exceptions=True)
    return heard


def _listen(package: ModuleType, traffic: Traffic, tally: Tally) -> Any:
    """A network of a peer with a callback on each TPDO of the three axes; to be connected."""
    network = package.Network()
    node = package.RemoteNode(NODE, str(EDS))
    network.add_node(node)

    def taken(pdo: Any) -> None:
        for variable in pdo:
            tally.total += variable.raw
        tally.frames += 1

    profile = Catalog.load().profile(MODEL)
    for axis, pdos in enumerate(traffic.pdos):
        for pdo, indices in ((pdos.status, STATUS_OBJECTS), (pdos.motion, MOTION_OBJECTS)):
            peers = node.tpdo[pdo.number]
            peers.clear()
            for index in indices:
                peers.add_variable(profile.layout.index(index, axis))
            peers.cob_id, peers.enabled = pdo.cob_id, True
            peers.add_callback(taken)
            peers.subscribe()
    return network


def _canopen(traffic: Traffic, count: int, rate: float) -> Heard:
    tally = Tally()
    with _paced(traffic, count, rate) as (near, pacer), wire.as_socketcan(near):
        network = _listen(canopen, traffic, tally)
        network.connect(interface="socketcan", channel=wire.CHANNEL)
        try:
            meter = Meter(traffic, pacer, tally, count)
            for pause in meter.ticks():
                time.sleep(pause)
            return meter.read()
        finally:
            network.disconnect()


async def _canopen_asyncio(traffic: Traffic, count: int, rate: float) -> Heard:
    tally = Tally()
    with _paced(traffic, count, rate) as (near, pacer), wire.as_socketcan(near):
        network = _listen(canopen_asyncio, traffic, tally)
        network.loop = asyncio.get_running_loop()
        network.connect(interface="socketcan", channel=wire.CHANNEL)
        try:
            meter = Meter(traffic, pacer, tally, count)
            for pause in meter.ticks():
                await asyncio.sleep(pause)
            return meter.read()
        finally:
            await asyncio.to_thread(network.disconnect)


def _on_uvloop(work: Coroutine[object, object, Heard]) -> Heard:
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        return runner.run(work)


Side = Callable[[Traffic, int, float], Heard]
SIDES: dict[str, Side] = {
    "uvloop": lambda *how: _on_uvloop(_canaxis(*how)),
    "asyncio": lambda *how: asyncio.run(_canaxis(*how)),
    "canopen": _canopen,
    "canopen-asyncio": lambda *how: asyncio.run(_canopen_asyncio(*how)),
}


def run(rounds: int, seconds: float) -> list[Row]:
    """See `bench.parts.Part`."""
    traffic = Traffic.make()
    with ahead_of_the_rest():
        return [row for name, rate in RATES for row in _at(name, rate, rounds, seconds, traffic)]


def _at(name: str, rate: int, rounds: int, seconds: float, traffic: Traffic) -> list[Row]:
    logging.getLogger("canopen").setLevel(logging.ERROR)
    heard: dict[str, list[Heard]] = {side: [] for side in SIDES}
    for _ in range(rounds):
        for side, measure in SIDES.items():
            heard[side].append(measure(traffic, round(rate * seconds), rate))
    cpu = {side: [each.cpu_us for each in all_of] for side, all_of in heard.items()}
    lost = {side: [each.lost for each in all_of] for side, all_of in heard.items()}
    what, unit, goal = f"a TPDO received, {name} ({rate:,}/s)", "us of CPU", Goal(0.25)
    nothing = Goal(0)
    return [
        Row.beside(f"{what}, uvloop", unit, cpu["uvloop"], cpu["canopen"], "canopen", goal),
        Row.beside(f"{what}, asyncio", unit, cpu["asyncio"], cpu["canopen"], "canopen"),
        Row.beside(f"{what}, uvloop", unit, cpu["uvloop"], cpu["canopen-asyncio"], "canopen-asyncio"),
        Row.alone("frames that Canaxis lost, uvloop", "frames", lost["uvloop"], nothing),
        Row.alone("frames that Canaxis lost, asyncio", "frames", lost["asyncio"], nothing),
        Row.alone("frames that canopen lost", "frames", lost["canopen"]),
        Row.alone("frames that canopen-asyncio lost", "frames", lost["canopen-asyncio"]),
    ]


if __name__ == "__main__":
    sys.exit(main(("receive",)))
