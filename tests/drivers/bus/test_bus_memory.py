from __future__ import annotations

import asyncio
from collections.abc import Sequence

import pytest
from bus_listener import Listener

from drivers.bus.base import BusCounters, BusState
from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.bus.memory import QUEUE, URGENT_RESERVE, MemoryBus, MemoryWire
from drivers.errors import BadValue, BusDown, BusOverflow

pytestmark = pytest.mark.looptime


async def ports(wire: MemoryWire, number: int) -> list[MemoryBus]:
    opened = [wire.port(f"port {index}") for index in range(number)]
    for port in opened:
        await port.open()
    return opened


async def turn() -> None:
    """Let a wire without a bit rate deliver."""
    await asyncio.sleep(0)
    await asyncio.sleep(0)


async def test_the_lowest_identifier_wins_among_the_ports(wire: MemoryWire, listen: type[Listener]):
    one, two, three = await ports(wire, 3)
    heard = listen(three)
    one.send(Frame(0x601))
    two.send(Frame(0x181))
    one.send(Frame(0x081))
    await turn()
    # 601h of the first port holds back its own 081h: a port's frames keep their order.
    assert [frame.cob_id for frame in heard.frames] == [0x181, 0x601, 0x081]
    assert len(heard.batches) == 1


async def test_of_equal_identifiers_each_port_keeps_its_order(wire: MemoryWire, listen: type[Listener]):
    one, two, three = await ports(wire, 3)
    heard = listen(three)
    for number in range(3):
        two.send(Frame(0x181, bytes([2, number])))
        one.send(Frame(0x181, bytes([1, number])))
    await turn()
    for port in (1, 2):
        assert [frame.data[1] for frame in heard.frames if frame.data[0] == port] == [0, 1, 2]


async def test_a_sender_does_not_hear_itself_and_everyone_else_does(wire: MemoryWire, listen: type[Listener]):
    opened = await ports(wire, 3)
    heard = [listen(port) for port in opened]
    opened[0].send(Frame(0x701, b"\x05"))
    await turn()
    assert [len(each.frames) for each in heard] == [0, 1, 1]
    assert opened[0].counters == BusCounters(sent=1)
    assert opened[1].counters == BusCounters(received=1)


async def test_urgent_frames_overtake_what_waits(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    one.send(Frame(0x201))
    one.send(Frame(0x601))
    one.send(Frame(0x77F), urgent=True)
    await turn()
    assert [frame.cob_id for frame in heard.frames] == [0x77F, 0x201, 0x601]


async def test_with_a_bit_rate_each_frame_takes_its_time(listen: type[Listener]):
    wire = MemoryWire(bit_rate=1_000_000)
    one, two = await ports(wire, 2)
    heard = listen(two)
    one.send(Frame(0x201, bytes(8)))
    one.send(Frame(0x202, b""))
    await heard.count(2)
    start = heard.frames[0].timestamp - 111e-6
    assert heard.frames[1].timestamp - start == pytest.approx(158e-6, abs=3e-6)


async def test_a_frame_on_the_wire_is_not_interrupted_by_a_better_one(listen: type[Listener]):
    wire = MemoryWire(bit_rate=125_000)
    one, two, three = await ports(wire, 3)
    heard = listen(three)
    one.send(Frame(0x601))
    one.send(Frame(0x602))
    await asyncio.sleep(100e-6)
    two.send(Frame(0x080))
    await heard.count(3)
    assert [frame.cob_id for frame in heard.frames] == [0x601, 0x080, 0x602]


async def test_timestamps_are_the_loops_time(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    await asyncio.sleep(3)
    one.send(Frame(0x181))
    await turn()
    assert heard.frames[0].timestamp == asyncio.get_running_loop().time()


async def test_unplugged_a_port_is_deaf_and_mute_until_plugged_in(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard, states = listen(two), listen(one)
    one.send(Frame(0x201))
    one.unplug()
    two.send(Frame(0x181))
    await turn()
    assert heard.frames == []
    assert states.frames == []
    with pytest.raises(BusDown, match="port 0 is down"):
        one.send(Frame(0x201))
    one.plug()
    one.send(Frame(0x202))
    assert [frame.cob_id for frame in await heard.count(1)] == [0x202]
    assert [state for state, _ in states.states] == [BusState.DOWN, BusState.ACTIVE]
    assert one.counters == BusCounters(sent=1, dropped=1, reopened=1)


async def test_an_unplugged_port_does_not_open(wire: MemoryWire):
    port = wire.port("port")
    port.unplug()
    with pytest.raises(BusDown, match="unplugged"):
        await port.open()
    port.plug()
    await port.open()
    assert port.state is BusState.ACTIVE


async def test_bus_off_is_seen_by_its_error_frame_and_ends_by_recovery(
    wire: MemoryWire, listen: type[Listener]
):
    one, two = await ports(wire, 2)
    mine, theirs = listen(one), listen(two)
    one.bus_off()
    assert one.state is BusState.BUS_OFF
    with pytest.raises(BusDown, match="bus-off"):
        one.send(Frame(0x201))
    one.recover()
    one.send(Frame(0x201))
    await theirs.count(1)
    assert [(frame.cob_id, frame.error) for frame in mine.frames] == [(0x40, True), (0x100, True)]
    assert [state for state, _ in mine.states] == [BusState.BUS_OFF, BusState.ACTIVE]


async def test_error_counters_degrade_a_port_that_still_sends(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    one.degrade(BusState.PASSIVE)
    one.send(Frame(0x201))
    await heard.count(1)
    assert one.state is BusState.PASSIVE
    with pytest.raises(BadValue):
        one.degrade(BusState.DOWN)


async def test_a_held_port_fills_up_and_keeps_room_for_urgent_frames(
    wire: MemoryWire, listen: type[Listener]
):
    one, two = await ports(wire, 2)
    heard = listen(two)
    one.hold()
    for _ in range(QUEUE):
        one.send(Frame(0x201))
    with pytest.raises(BusOverflow, match="transmit queue of port 0 is full"):
        one.send(Frame(0x201))
    for _ in range(URGENT_RESERVE):
        one.send(Frame(0x000), urgent=True)
    with pytest.raises(BusOverflow):
        one.send(Frame(0x000), urgent=True)
    await turn()
    assert heard.frames == []
    one.release()
    assert len(await heard.count(QUEUE + URGENT_RESERVE)) == QUEUE + URGENT_RESERVE
    assert heard.frames[0].cob_id == 0x000
    assert one.counters.dropped == 2


async def test_what_was_held_for_long_never_leaves(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    one.hold()
    one.send(Frame(0x201))
    await asyncio.sleep(1)
    one.send(Frame(0x202))
    one.release()
    assert [frame.cob_id for frame in await heard.count(1)] == [0x202]
    assert one.counters == BusCounters(sent=1, dropped=1)


async def test_faults_act_between_sender_and_receivers(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    wire.faults.drop(cob_id(0x181), count=1)
    wire.faults.delay(cob_id(0x281), 0.5)
    wire.faults.duplicate(cob_id(0x381))
    wire.faults.corrupt(lambda frame: frame._replace(data=b"\xff"), cob_id(0x481))
    begin = asyncio.get_running_loop().time()
    for frame in (Frame(0x181), Frame(0x281), Frame(0x381), Frame(0x481, b"\x00"), Frame(0x181)):
        one.send(frame)
    frames = await heard.count(5)
    assert [frame.cob_id for frame in frames] == [0x381, 0x381, 0x481, 0x181, 0x281]
    assert frames[2].data == b"\xff"
    assert heard.frames[4].timestamp == pytest.approx(begin + 0.5, abs=0.01)


async def test_a_tap_sees_what_crosses_the_wire_and_from_whom(wire: MemoryWire):
    one, _ = await ports(wire, 2)
    seen: list[tuple[str, int]] = []
    end = wire.tap(lambda sender, frame: seen.append((sender, frame.cob_id)))
    one.send(Frame(0x181))
    await turn()
    wire.inject(Frame(0x281))
    end()
    wire.inject(Frame(0x381))
    assert seen == [("port 0", 0x181), ("", 0x281)]


async def test_injected_frames_reach_every_port(wire: MemoryWire, listen: type[Listener]):
    opened = await ports(wire, 2)
    heard = [listen(port) for port in opened]
    wire.inject(Frame(0x004, bytes(8), error=True))
    assert [each.frames[0].error for each in heard] == [True, True]


async def test_closing_lets_out_what_waits(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    one.send(Frame(0x000))
    await one.close()
    await one.close()
    assert [frame.cob_id for frame in heard.frames] == [0x000]
    assert one.state is BusState.CLOSED
    with pytest.raises(BusDown, match="closed"):
        one.send(Frame(0x000))


async def test_closing_waits_no_longer_than_a_tenth_of_a_second(wire: MemoryWire):
    (one,) = await ports(wire, 1)
    one.hold()
    one.send(Frame(0x000))
    begin = asyncio.get_running_loop().time()
    await one.close()
    assert asyncio.get_running_loop().time() - begin <= 0.11
    assert one.counters.dropped == 1


async def test_what_no_controller_can_send_is_refused(wire: MemoryWire):
    (one,) = await ports(wire, 1)
    with pytest.raises(BadValue, match="no frame that a controller can send"):
        one.send(Frame(0x800))
    with pytest.raises(BadValue):
        MemoryWire(bit_rate=0)


async def test_a_handler_that_fails_leaves_the_others_their_frames(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    complaints: list[dict[str, object]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context))

    def fails(_: object) -> None:
        raise ZeroDivisionError

    def fails_too(_: object, __: object) -> None:
        raise ZeroDivisionError

    two.subscribe(fails, fails_too)
    heard = listen(two)
    one.send(Frame(0x181))
    await turn()
    two.unplug()
    assert len(heard.frames) == 1
    assert heard.states[0][0] is BusState.DOWN
    assert [context["message"] for context in complaints] == [
        "a frame handler failed",
        "a bus state handler failed",
    ]


async def test_who_has_unsubscribed_hears_nothing_more(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    heard.stop()
    heard.stop()
    one.send(Frame(0x181))
    await turn()
    assert heard.frames == []


async def test_a_discarded_port_is_gone(wire: MemoryWire, listen: type[Listener]):
    one, two = await ports(wire, 2)
    heard = listen(two)
    wire.discard(two)
    one.send(Frame(0x181))
    await turn()
    assert heard.frames == []


async def test_with_a_lead_one_frame_comes_at_once_and_many_keep_the_bit_rate():
    opened = await ports(MemoryWire(bit_rate=1_000_000, lead=0.001), 2)
    loop = asyncio.get_running_loop()
    came: asyncio.Queue[float] = asyncio.Queue()

    def note(batch: Sequence[Frame]) -> None:
        for _ in batch:
            came.put_nowait(loop.time())

    opened[1].subscribe(note)
    began = loop.time()
    opened[0].send(Frame(0x181, bytes(8)))
    assert await came.get() == began
    for _ in range(100):
        opened[0].send(Frame(0x181, bytes(8)))
    last = [await came.get() for _ in range(100)][-1]
    assert last - began == pytest.approx(101 * 125e-6 - 0.001, rel=0.15)
