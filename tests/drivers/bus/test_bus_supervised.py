"""Supervision and the transmit queue, over a link that the test holds in its hand."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Iterator

import pytest
from bus_listener import Listener

from drivers.bus.base import BusCounters, BusState
from drivers.bus.frame import Frame
from drivers.bus.reader import DescriptorReader, Lost
from drivers.bus.supervised import SupervisedBus
from drivers.errors import BadValue, BusDown, BusOverflow


class FakeLink:
    """Read by a thread that waits for nothing; `full` and `broken` are switches."""

    def __init__(self) -> None:
        self.is_off = False
        self.shows_all = False
        self.overrun = 0
        self.full = False
        self.broken = False
        self.closed = False
        self.written: list[Frame] = []

    def descriptor(self) -> int | None:
        return FakeLink.pipe

    def receive(self, timeout: float) -> Frame | None:
        if self.broken:
            raise Lost("the link is down (errno 100)")
        return None

    def drain(self, into: list[Frame], limit: int) -> None:
        if self.broken:
            raise Lost("the link is down (errno 100)")

    def write(self, frame: Frame) -> bool:
        if self.broken:
            raise Lost("the link is down (errno 100)")
        if not self.full:
            self.written.append(frame)
        return not self.full

    async def close(self) -> None:
        self.closed = True

    pipe: int


class FakeWire:
    """Makes links, as long as it is there."""

    def __init__(self) -> None:
        self.links: list[FakeLink] = []
        self.tries: list[float] = []
        self.there = True

    async def connect(self) -> FakeLink:
        self.tries.append(asyncio.get_running_loop().time())
        if not self.there:
            raise BusDown("nothing there")
        await asyncio.sleep(0)
        self.links.append(FakeLink())
        return self.links[-1]


@pytest.fixture
def fake() -> Iterator[FakeWire]:
    """A wire, whose links show a descriptor that never becomes readable."""
    reading, writing = os.pipe()
    FakeLink.pipe = reading
    yield FakeWire()
    os.close(reading)
    os.close(writing)


@pytest.fixture
async def bus(fake: FakeWire) -> AsyncIterator[SupervisedBus]:
    bus = SupervisedBus("fake", fake.connect)
    await bus.open()
    yield bus
    await bus.close()


pytestmark = pytest.mark.looptime


async def test_a_first_failure_is_raised_and_leaves_the_bus_closed(fake: FakeWire):
    fake.there = False
    bus = SupervisedBus("fake", fake.connect)
    with pytest.raises(BusDown, match="nothing there"):
        await bus.open()
    assert bus.state is BusState.CLOSED
    await asyncio.sleep(60)
    assert len(fake.tries) == 1
    fake.there = True
    await bus.open()
    assert bus.state is BusState.ACTIVE
    await bus.close()


async def test_opening_an_open_bus_changes_nothing(bus: SupervisedBus, fake: FakeWire):
    await bus.open()
    assert len(fake.links) == 1


async def test_opened_twice_at_once_the_bus_keeps_one_link(fake: FakeWire):
    bus = SupervisedBus("fake", fake.connect)
    await asyncio.gather(bus.open(), bus.open())
    bus.send(Frame(0x000))
    assert len([link for link in fake.links if not link.closed]) == 1
    await bus.close()


async def test_a_full_interface_makes_frames_wait_and_urgent_ones_leave_first(
    bus: SupervisedBus, fake: FakeWire
):
    link = fake.links[0]
    link.full = True
    bus.send(Frame(0x201))
    bus.send(Frame(0x601))
    bus.send(Frame(0x000), urgent=True)
    await asyncio.sleep(0.05)
    link.full = False
    await asyncio.sleep(0.02)
    assert [frame.cob_id for frame in link.written] == [0x000, 0x201, 0x601]
    assert bus.counters == BusCounters(sent=3)


async def test_an_urgent_frame_overtakes_at_once_what_waits(bus: SupervisedBus, fake: FakeWire):
    link = fake.links[0]
    link.full = True
    bus.send(Frame(0x201))
    link.full = False
    bus.send(Frame(0x000), urgent=True)
    assert [frame.cob_id for frame in link.written] == [0x000]
    bus.send(Frame(0x202))
    assert len(link.written) == 1  # an ordinary one waits its turn
    await asyncio.sleep(0.02)
    assert [frame.cob_id for frame in link.written] == [0x000, 0x201, 0x202]


async def test_urgent_frames_leave_in_their_order_though_there_is_room_for_the_last(
    bus: SupervisedBus, fake: FakeWire
):
    """A halt and what follows it: the later one must not be undone by the earlier one."""
    link = fake.links[0]
    link.full = True
    bus.send(Frame(0x201, b"\x01"), urgent=True)
    bus.send(Frame(0x201, b"\x02"), urgent=True)
    link.full = False
    bus.send(Frame(0x201, b"\x03"), urgent=True)
    await asyncio.sleep(0.02)
    assert [frame.data for frame in link.written] == [b"\x01", b"\x02", b"\x03"]


async def test_overflow_is_raised_for_ordinary_frames_while_urgent_ones_have_room(
    bus: SupervisedBus, fake: FakeWire
):
    fake.links[0].full = True
    for _ in range(256):
        bus.send(Frame(0x201))
    with pytest.raises(BusOverflow, match="nobody takes our frames"):
        bus.send(Frame(0x201))
    bus.send(Frame(0x000), urgent=True)


async def test_frames_that_waited_too_long_never_leave(bus: SupervisedBus, fake: FakeWire):
    link = fake.links[0]
    link.full = True
    bus.send(Frame(0x201))
    await asyncio.sleep(1)
    link.full = False
    await asyncio.sleep(1)
    assert link.written == []
    assert bus.counters.dropped == 1


async def test_a_lost_wire_is_reopened_with_a_growing_and_bounded_pause(
    bus: SupervisedBus, fake: FakeWire, listen: type[Listener]
):
    heard = listen(bus)
    fake.there = False
    fake.links[0].broken = True
    with pytest.raises(BusDown, match="went down"):
        bus.send(Frame(0x201))
    assert bus.state is BusState.DOWN
    assert "the link is down" in heard.states[0][1]
    await asyncio.sleep(30)
    pauses = [after - before for before, after in zip(fake.tries[1:], fake.tries[2:], strict=False)]
    assert pauses[:5] == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.2], abs=0.01)
    assert pauses[5:] == pytest.approx([5.0] * len(pauses[5:]), abs=0.01)
    assert len(pauses) > 6
    fake.there = True
    await heard.state(BusState.ACTIVE)
    assert fake.links[0].closed
    assert len(fake.links) == 2
    bus.send(Frame(0x201))
    assert len(fake.links[1].written) == 1
    assert bus.counters == BusCounters(sent=1, reopened=1)


async def test_what_waited_when_the_wire_was_lost_is_not_sent_later(
    bus: SupervisedBus, fake: FakeWire, listen: type[Listener]
):
    heard = listen(bus)
    fake.links[0].full = True
    bus.send(Frame(0x201))
    fake.links[0].broken = True
    await heard.state(BusState.DOWN)
    await heard.state(BusState.ACTIVE)
    await asyncio.sleep(1)
    assert fake.links[1].written == []
    assert bus.counters.dropped == 1


async def test_closing_while_down_ends_the_tries(bus: SupervisedBus, fake: FakeWire):
    fake.there = False
    fake.links[0].broken = True
    with pytest.raises(BusDown):
        bus.send(Frame(0x201))
    await asyncio.sleep(1)
    await bus.close()
    tries = len(fake.tries)
    await asyncio.sleep(60)
    assert len(fake.tries) == tries
    assert bus.state is BusState.CLOSED


async def test_closing_gives_waiting_frames_a_tenth_of_a_second(bus: SupervisedBus, fake: FakeWire):
    link = fake.links[0]
    link.full = True
    bus.send(Frame(0x000), urgent=True)
    asyncio.get_running_loop().call_later(0.05, setattr, link, "full", False)
    await bus.close()
    assert [frame.cob_id for frame in link.written] == [0x000]
    assert link.closed


async def test_a_controller_that_was_bus_off_before_is_not_called_active(fake: FakeWire):
    bus = SupervisedBus("fake", fake.connect)

    async def off() -> FakeLink:
        link = FakeLink()
        link.is_off = True
        return link

    bus = SupervisedBus("fake", off)
    await bus.open()
    assert bus.state is BusState.BUS_OFF
    with pytest.raises(BusDown, match="bus-off"):
        bus.send(Frame(0x201))
    await bus.close()


async def test_what_no_controller_can_send_is_refused(bus: SupervisedBus):
    with pytest.raises(BadValue):
        bus.send(Frame(0x201, bytes(9)))


async def test_only_what_is_answered_makes_the_reader_hurry(
    bus: SupervisedBus, fake: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    hurries: list[None] = []
    monkeypatch.setattr(DescriptorReader, "expect_answer", lambda _: hurries.append(None))
    await bus.open()
    bus.send(Frame(0x77F, b"\x05"), urgent=True, answered=False)
    assert not hurries, "a heartbeat leaves the reading of a stream as it is"
    bus.send(Frame(0x601, bytes(8)))
    assert len(hurries) == 1
    fake.links[0].full = True
    bus.send(Frame(0x601, bytes(8)))
    fake.links[0].full = False
    before = len(hurries)
    while len(fake.links[0].written) < 3:  # noqa: ASYNC110 - a fake tells nobody
        await asyncio.sleep(0.001)
    assert len(hurries) > before, "the answer comes after the frame has left"
