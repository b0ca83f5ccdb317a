"""Any schedule of readers, writers and cancellations on a wire that loses, delays and doubles frames."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass, field
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from virtual_clock import virtual_loop

from drivers.bus.frame import Frame
from drivers.cia301.objects import Address
from drivers.cia301.sdo import SdoServer
from drivers.errors import SdoError
from drivers.master.ground.timing import Timing
from drivers.master.sdo.client import SdoClient
from drivers.master.sdo.queue import Priority, SdoQueue

ROOM = 5
SHORT = (Address(0x2000), Address(0x2001))
LONG = (Address(0x3000), Address(0x3001))
FLIGHT = 0.001
TIMING = Timing(sdo_response=0.3, sdo_quarantine=0.25, sdo_queue=2.0)


FATES = (*[FLIGHT] * 8, 0.02, 0.06, 0.1, 0.31, 0.35, 0.5, math.inf)
"""After how long an answer arrives; an infinite time where it is lost."""


@dataclass(frozen=True)
class Action:
    """What one client does, some time after the one before."""

    pause: float
    address: Address
    writes: bool
    priority: Priority
    within: float | None
    cancelled_after: float | None


def drawn(random: Random) -> Action:
    """An action; drawn here, because hypothesis seldom lets several things happen at once."""
    return Action(
        random.choice((0.0, 0.0, 0.0, FLIGHT, 0.01, 0.3)),
        random.choice(SHORT + LONG),
        random.random() < 0.4,
        random.choice((*Priority, Priority.MONITOR, Priority.MONITOR)),
        random.choice((None, None, None, 0.01, 0.4)),
        random.choice((None,) * 6 + (0.0, FLIGHT, 0.2)),
    )


class Node:
    """A node whose objects say which they are and how often they were written."""

    def __init__(self, random: Random) -> None:
        self.versions = dict.fromkeys(SHORT + LONG, 0)
        self.client = SdoClient(5, self._send, TIMING)
        self.client._queue = SdoQueue(ROOM)
        self._server = SdoServer(self._read, self._write)
        self._random = random

    def value(self, address: Address, version: int) -> bytes:
        data = bytes((address.index >> 8, address.index & 0xFF, address.sub, version))
        return data if address in SHORT else data * 5

    def _read(self, address: Address) -> bytes:
        return self.value(address, self.versions[address])

    def _write(self, address: Address, data: bytes) -> None:
        self.versions[address] = max(data[3], self.versions[address])

    def _send(self, frame: Frame) -> None:
        answer = self._server.feed(frame.data)
        if answer is None:
            return
        after = self._random.choice(FATES)
        if after == math.inf:
            return
        loop = asyncio.get_running_loop()
        for _ in range(2 if self._random.random() < 0.1 else 1):
            loop.call_later(after, self.client.on_frame, Frame(0x585, answer))


@dataclass
class Ledger:
    """What was asked and what came of it."""

    asked: list[tuple[Address, Priority, int]] = field(default_factory=list)
    """The writes."""
    acknowledged: set[int] = field(default_factory=set)
    """Versions whose write was confirmed."""
    read: list[tuple[list[int], int]] = field(default_factory=list)
    """For each read the versions that had been asked for no less urgently before it, and what it brought."""

    def before(self, address: Address, priority: Priority) -> list[int]:
        return [v for at, urgency, v in self.asked if at == address and urgency <= priority]

    def newest(self, versions: list[int]) -> int:
        return max((v for v in versions if v in self.acknowledged), default=0)


async def act(node: Node, action: Action, version: int, ledger: Ledger) -> None:
    """One client's transfer: it gets what belongs to its address and is new enough, or an error."""
    address, client, priority = action.address, node.client, action.priority
    confirmed = ledger.newest([v for at, _, v in ledger.asked if at == address])
    refused = None
    try:
        if action.writes:
            ledger.asked.append((address, priority, version))
            await client.download(
                address, node.value(address, version), priority=priority, within=action.within
            )
            assert node.versions[address] >= version
            ledger.acknowledged.add(version)
        else:
            before = ledger.before(address, priority)
            data = await client.upload(address, priority=priority, within=action.within)
            assert data == node.value(address, data[3]), "another object's value, or a mixture"
            assert confirmed <= data[3] <= node.versions[address]
            ledger.read.append((before, data[3]))
    except SdoError as error:
        refused = error
    assert refused is None or (refused.index, refused.sub) == address


async def play(schedule: list[Action], node: Node) -> None:
    loop = asyncio.get_running_loop()
    ledger = Ledger()
    tasks: list[asyncio.Task[None]] = []
    for version, action in enumerate(schedule, start=1):
        await asyncio.sleep(action.pause)
        task = loop.create_task(act(node, action, version, ledger))
        tasks.append(task)
        if action.cancelled_after is not None:
            loop.call_later(action.cancelled_after, task.cancel)
        await asyncio.sleep(0)
        assert node.client.waiting <= ROOM
    async with asyncio.timeout(60):
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            assert result is None or isinstance(result, asyncio.CancelledError), result
    assert all(ledger.newest(before) <= got for before, got in ledger.read), "a value from before a write"
    assert node.client.idle
    await asyncio.sleep(60)
    assert node.client._timer is None
    assert not node.client._shareable


@settings(max_examples=300)
@given(st.integers(0, 2**32))
def test_every_caller_gets_its_own_value_or_an_error(seed: int) -> None:
    random = Random(seed)
    schedule = [drawn(random) for _ in range(random.randint(1, 25))]
    problems: list[str] = []
    with asyncio.Runner(loop_factory=virtual_loop) as runner:
        runner.get_loop().set_exception_handler(lambda _, context: problems.append(str(context)))

        async def run() -> None:
            await play(schedule, Node(random))

        runner.run(run())
    assert not problems
