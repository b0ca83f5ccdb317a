"""`PythonCanBus` over python-can's `virtual` (a reader thread) and `socketcand` (the event loop)."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack
from itertools import pairwise
from typing import Any

import can
import canopen
import pytest
from bus_listener import Listener
from can.interfaces.virtual import VirtualBus
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.bus.base import BusState
from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.bus.pythoncan import PythonCanBus
from drivers.bus.reader import DescriptorReader, ThreadReader
from drivers.errors import BadValue, BusDown, BusOverflow
from drivers.sim.socketcand import SocketcandServer

Open = Callable[..., Awaitable[PythonCanBus]]

TRAVELLERS = [
    Frame(0x000, b"\x01\x00"),
    Frame(0x080),
    Frame(0x7FF, bytes(range(8))),
    Frame(0x1FFFFFFF, b"\xff", extended=True),
    Frame(0x000, b"\x00", extended=True),
]


@pytest.fixture
async def open_bus() -> AsyncIterator[Open]:
    async with AsyncExitStack() as stack:

        async def open_it(interface: str, channel: str, **options: Any) -> PythonCanBus:
            bus = PythonCanBus(interface, channel, **options)
            stack.push_async_callback(bus.close)
            await bus.open()
            return bus

        yield open_it


@pytest.fixture
async def node(wire: MemoryWire) -> AsyncIterator[MemoryBus]:
    node = wire.port("node")
    await node.open()
    yield node
    await node.close()


@pytest.fixture
async def bus(server: SocketcandServer, open_bus: Open) -> PythonCanBus:
    return await open_bus("socketcand", "can0", port=server.port)


# --- virtual: no descriptor


async def test_a_thread_reads_an_interface_without_a_descriptor(
    open_bus: Open, listen: type[Listener], request: pytest.FixtureRequest
):
    one = await open_bus("virtual", request.node.name)
    two = await open_bus("virtual", request.node.name)
    heard = listen(two)
    for frame in TRAVELLERS:
        one.send(frame)
    assert await heard.count(len(TRAVELLERS)) == TRAVELLERS
    assert isinstance(two._reader, ThreadReader)
    assert one.counters.sent == two.counters.received == len(TRAVELLERS)


async def test_a_thread_hands_over_what_gathered_in_batches(
    open_bus: Open, listen: type[Listener], request: pytest.FixtureRequest
):
    one = await open_bus("virtual", request.node.name)
    two = await open_bus("virtual", request.node.name)
    heard = listen(two)
    for number in range(2000):
        one.send(Frame(0x181, number.to_bytes(2, "little")))
    frames = await heard.count(2000)
    assert [int.from_bytes(frame.data, "little") for frame in frames] == list(range(2000))
    assert len(heard.batches) < 1000
    assert max(len(batch) for batch in heard.batches) <= 256


async def test_an_interface_that_takes_no_frame_in_time_is_full_and_not_gone(
    open_bus: Open, listen: type[Listener], request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
):
    one = await open_bus("virtual", request.node.name)
    two = await open_bus("virtual", request.node.name)
    states, heard = listen(one), listen(two)
    send = VirtualBus.send

    def refuse(*_: object, **__: object) -> None:
        monkeypatch.setattr(VirtualBus, "send", send)
        raise can.CanTimeoutError("transmit queue full")

    monkeypatch.setattr(VirtualBus, "send", refuse)
    one.send(Frame(0x201))
    assert (states.states, one.state) == ([], BusState.ACTIVE)
    while not heard.frames:  # a slow machine may let one grow stale
        one.send(Frame(0x202))
        await asyncio.sleep(0.01)
    assert states.states == []


async def test_an_interface_that_fails_otherwise_is_gone(
    open_bus: Open, listen: type[Listener], request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
):
    bus = await open_bus("virtual", request.node.name)
    heard = listen(bus)

    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("the adapter's firmware hangs")

    monkeypatch.setattr(VirtualBus, "send", fail)
    with pytest.raises(BusDown):
        bus.send(Frame(0x201))
    assert "firmware hangs" in await heard.state(BusState.DOWN)


async def test_an_unknown_interface_is_said_in_a_sentence(open_bus: Open):
    with pytest.raises(BusDown, match="carrier-pigeon:can0 can't be opened"):
        await open_bus("carrier-pigeon", "can0")


async def test_a_missing_socketcan_interface_is_said_in_a_sentence(open_bus: Open):
    with pytest.raises(BusDown, match="there is no CAN interface can77 here"):
        await open_bus("socketcan", "can77")


def test_what_the_bus_decides_itself_is_refused():
    with pytest.raises(BadValue, match="receive_own_messages"):
        PythonCanBus("virtual", "x", receive_own_messages=True)


def test_the_name_says_which_bus_it_is():
    assert PythonCanBus("socketcan", "can0", bitrate=1_000_000).name == "socketcan:can0"
    assert PythonCanBus("socketcand", "can0").name == "socketcand:can0@127.0.0.1:29536"


# --- socketcand: watched by the event loop


async def test_frames_travel_both_ways_over_socketcand(
    bus: PythonCanBus, node: MemoryBus, listen: type[Listener]
):
    there, here = listen(node), listen(bus)
    for frame in TRAVELLERS:
        bus.send(frame)
        node.send(frame)
    assert await there.count(len(TRAVELLERS)) == TRAVELLERS
    assert await here.count(len(TRAVELLERS)) == TRAVELLERS
    assert isinstance(bus._reader, DescriptorReader)


async def test_a_flood_arrives_whole_in_order_and_in_bounded_batches(
    bus: PythonCanBus, node: MemoryBus, listen: type[Listener]
):
    heard = listen(bus)
    for start in range(0, 3000, 200):
        for number in range(start, start + 200):
            node.send(Frame(0x181, number.to_bytes(2, "little")))
        await asyncio.sleep(0)
    frames = await heard.count(3000)
    assert [int.from_bytes(frame.data, "little") for frame in frames] == list(range(3000))
    assert 3000 / 256 <= len(heard.batches) < 1500
    assert max(len(batch) for batch in heard.batches) <= 256


async def test_several_clients_hear_each_other(
    open_bus: Open, server: SocketcandServer, listen: type[Listener]
):
    buses = [await open_bus("socketcand", "can0", port=server.port) for _ in range(3)]
    heard = [listen(bus) for bus in buses]
    for number, bus in enumerate(buses):
        bus.send(Frame(0x180 + number))
    for number, each in enumerate(heard):
        frames = await each.count(2)
        assert {frame.cob_id for frame in frames} == {0x180, 0x181, 0x182} - {0x180 + number}


async def test_opening_succeeds_while_the_wire_is_busy(
    wire: MemoryWire, server: SocketcandServer, node: MemoryBus, open_bus: Open, listen: type[Listener]
):
    async def chatter() -> None:
        while True:
            node.send(Frame(0x181, bytes(8)))
            await asyncio.sleep(0.0005)

    chattering = asyncio.create_task(chatter())
    try:
        for _ in range(5):
            bus = await open_bus("socketcand", "can0", port=server.port)
            await listen(bus).count(3)
    finally:
        chattering.cancel()


@settings(
    max_examples=25,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    deadline=None,
)
@given(
    st.lists(
        st.tuples(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.booleans()), min_size=1, max_size=20
    )
)
def test_random_frames_survive_the_trip(listen: type[Listener], contents: list[tuple[int, bytes, bool]]):
    frames = [Frame(cob_id if ext else cob_id & 0x7FF, data, extended=ext) for cob_id, data, ext in contents]

    async def trip() -> list[Frame]:
        wire = MemoryWire()
        server = SocketcandServer(wire, port=0)
        await server.start()
        one = PythonCanBus("socketcand", "can0", port=server.port)
        two = PythonCanBus("socketcand", "can0", port=server.port)
        await one.open()
        await two.open()
        heard = listen(two)
        for frame in frames:
            one.send(frame)
        try:
            return await heard.count(len(frames))
        finally:
            await one.close()
            await two.close()
            await server.close()

    assert asyncio.run(trip()) == frames


async def test_a_missing_server_is_a_quick_and_clear_refusal(open_bus: Open, unused_tcp_port: int):
    with pytest.raises(
        BusDown, match=f"nothing listens on 127.0.0.1:{unused_tcp_port}.*canaxis simulate"
    ) as refusal:
        async with asyncio.timeout(2):
            await open_bus("socketcand", "can0", port=unused_tcp_port)
    assert "canaxis simulate" in refusal.value.hint


async def test_another_kind_of_server_is_recognised(open_bus: Open, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("drivers.bus.probe.GREETING", 0.1)
    greetings = [b"HTTP/1.1 400 >", b""]
    hung_up = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(greetings.pop(0))
        await reader.read()
        writer.close()
        if not greetings:
            hung_up.set()

    impostor = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = impostor.sockets[0].getsockname()[1]
    with pytest.raises(BusDown, match="is no socketcand server"):
        await open_bus("socketcand", "can0", port=port)
    with pytest.raises(BusDown, match="is silent"):
        await open_bus("socketcand", "can0", port=port)
    await hung_up.wait()
    impostor.close()


async def test_the_bus_goes_down_with_its_server_and_comes_back_with_it(
    wire: MemoryWire, open_bus: Open, listen: type[Listener]
):
    server = SocketcandServer(wire, port=0)
    await server.start()
    bus = await open_bus("socketcand", "can0", port=server.port)
    heard = listen(bus)
    await server.close()
    assert "the socketcand server closed the connection" in await heard.state(BusState.DOWN)
    with pytest.raises(BusDown, match="is down"):
        bus.send(Frame(0x000))
    again = SocketcandServer(wire, port=server.port)
    await again.start()
    await heard.state(BusState.ACTIVE)
    peer = wire.port("peer")
    await peer.open()
    peer.send(Frame(0x701, b"\x05"))
    assert await heard.count(1) == [Frame(0x701, b"\x05")]
    assert bus.counters.reopened == 1
    await again.close()
    await peer.close()


async def test_a_server_that_reads_nothing_fills_the_queue_but_never_blocks(open_bus: Open):
    stalled = asyncio.Event()
    done = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"< hi >")
        try:
            for _ in range(2):
                await reader.readuntil(b">")
                writer.write(b"< ok >")
        except asyncio.IncompleteReadError:  # the probe
            writer.close()
            return
        writer.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        assert isinstance(writer.transport, asyncio.Transport)
        writer.transport.pause_reading()
        stalled.set()
        await done.wait()
        writer.transport.abort()

    server = await asyncio.start_server(serve, "127.0.0.1", 0, limit=64)
    bus = await open_bus("socketcand", "can0", port=server.sockets[0].getsockname()[1])
    await stalled.wait()
    loop = asyncio.get_running_loop()
    times: list[float] = []

    def flood() -> None:
        while True:
            times.append(loop.time())
            bus.send(Frame(0x201, bytes(8)))

    with pytest.raises(BusOverflow):
        flood()
    assert max(after - before for before, after in pairwise(times)) < 1
    bus.send(Frame(0x000), urgent=True)
    await bus.close()
    done.set()
    server.close()


async def test_error_frames_over_socketcand_tell_of_bus_off(
    bus: PythonCanBus, wire: MemoryWire, listen: type[Listener]
):
    heard = listen(bus)
    wire.inject(Frame(0x040, bytes(8), error=True))
    assert "bus-off" in await heard.state(BusState.BUS_OFF)
    assert heard.frames[0].error
    assert heard.frames[0].cob_id == 0x040
    with pytest.raises(BusDown, match="bus-off"):
        bus.send(Frame(0x000))
    wire.inject(Frame(0x100, bytes(8), error=True))
    await heard.state(BusState.ACTIVE)


async def test_canopen_joins_as_a_plain_client(server: SocketcandServer, node: MemoryBus):
    network = canopen.Network()
    heard: list[int] = []
    loop = asyncio.get_running_loop()
    news = asyncio.Event()

    def on_heartbeat(cob_id: int, data: bytearray, timestamp: float) -> None:
        heard.append(data[0])
        loop.call_soon_threadsafe(news.set)

    def connect() -> None:
        network.connect(interface="socketcand", host="127.0.0.1", port=server.port, channel="can0")
        network.subscribe(0x701, on_heartbeat)

    await asyncio.to_thread(connect)
    try:
        node.send(Frame(0x701, b"\x05"))
        async with asyncio.timeout(10):
            await news.wait()
        assert heard == [0x05]
    finally:
        await asyncio.to_thread(network.disconnect)


async def test_a_remote_request_passes_to_the_wire(
    server: SocketcandServer, node: MemoryBus, listen: type[Listener]
):
    heard = listen(node)

    def request() -> None:
        with can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=server.port) as raw:
            raw.send(can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True, dlc=1))

    await asyncio.to_thread(request)
    assert await heard.count(1) == [Frame(0x701, remote=True)]
