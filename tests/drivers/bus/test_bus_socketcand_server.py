"""The server, spoken to in plain text."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, suppress

import pytest
from bus_listener import Listener

from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.errors import BusError
from drivers.sim import socketcand
from drivers.sim.socketcand import SocketcandServer


class Peer:
    """A client that says exactly what the test lets it say."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    def say(self, text: str) -> None:
        self.writer.write(text.encode())

    async def hear(self) -> str:
        async with asyncio.timeout(10):
            return (await self.reader.readuntil(b">")).decode()

    async def at_end(self) -> bool:
        async with asyncio.timeout(10):
            return await self.reader.read() == b""

    async def raw(self) -> Peer:
        assert await self.hear() == "< hi >"
        self.say("< open can0 >")
        assert await self.hear() == "< ok >"
        self.say("< rawmode >")
        assert await self.hear() == "< ok >"
        return self


Dial = Callable[[], Awaitable[Peer]]


@pytest.fixture
async def dial(server: SocketcandServer) -> AsyncIterator[Dial]:
    async with AsyncExitStack() as stack:

        async def connect() -> Peer:
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)

            async def hang_up() -> None:
                writer.close()
                with suppress(ConnectionError):
                    await writer.wait_closed()

            stack.push_async_callback(hang_up)
            return Peer(reader, writer)

        yield connect


@pytest.fixture
async def node(wire: MemoryWire) -> AsyncIterator[MemoryBus]:
    node = wire.port("node")
    await node.open()
    yield node
    await node.close()


async def test_a_client_hears_the_wire_and_the_wire_hears_the_client(
    dial: Dial, node: MemoryBus, listen: type[Listener]
):
    heard = listen(node)
    peer = await (await dial()).raw()
    node.send(Frame(0x701, b"\x05"))
    assert (await peer.hear()).startswith("< frame 701 ")
    peer.say("< send 601 8 40 41 60 0 0 0 0 0 >")
    assert await heard.count(1) == [Frame(0x601, bytes([0x40, 0x41, 0x60, 0, 0, 0, 0, 0]))]


async def test_clients_hear_each_other_but_not_themselves(dial: Dial, server: SocketcandServer):
    one, two = await (await dial()).raw(), await (await dial()).raw()
    assert server.clients == 2
    one.say("< send 123 1 aa >")
    assert " AA >" in await two.hear()
    two.say("< send 124 1 bb >")
    assert " BB >" in await one.hear()


async def test_frames_wait_until_the_client_has_surely_read_the_answer(
    dial: Dial, node: MemoryBus, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(socketcand, "HOLD_BACK", 3600.0)
    peer = await dial()
    await peer.hear()
    peer.say("< open can0 >")
    await peer.hear()
    peer.say("< rawmode >")
    assert await peer.hear() == "< ok >"
    node.send(Frame(0x701, b"\x05"))
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.05):
            await peer.reader.read(1)
    peer.say("< echo >")
    assert (await peer.hear()).startswith("< frame 701 ")
    assert await peer.hear() == "< echo >"


async def test_frames_held_back_come_by_themselves_after_a_while(
    dial: Dial, node: MemoryBus, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(socketcand, "HOLD_BACK", 0.02)
    peer = await (await dial()).raw()
    node.send(Frame(0x701, b"\x05"))
    assert (await peer.hear()).startswith("< frame 701 ")


@pytest.mark.parametrize(
    "command",
    ["< bcmmode >", "< stat 1 >", "<>", "nonsense >", "< send 123 3 1 >", "< send 800 0 >", "x" * 300],
)
async def test_what_is_not_understood_is_answered_and_counted(
    dial: Dial, server: SocketcandServer, command: str
):
    peer = await (await dial()).raw()
    peer.say(command)
    assert (await peer.hear()).startswith("< error ")
    assert server.counters.malformed == 1
    peer.say("< echo >")
    assert await peer.hear() == "< echo >"


async def test_commands_may_come_in_pieces_and_together(dial: Dial, node: MemoryBus, listen: type[Listener]):
    heard = listen(node)
    peer = await (await dial()).raw()
    peer.say("< send 1")
    await asyncio.sleep(0)
    peer.say("23 0 >< send 124 0 >\n< send 125 0 >")
    assert [frame.cob_id for frame in await heard.count(3)] == [0x123, 0x124, 0x125]


async def test_before_open_there_is_nothing_to_send_on(dial: Dial):
    peer = await dial()
    await peer.hear()
    peer.say("< send 123 0 >")
    assert await peer.hear() == "< error unknown command >"


async def test_an_unknown_channel_is_refused_and_the_connection_ends(dial: Dial):
    peer = await dial()
    await peer.hear()
    peer.say("< open can7 >")
    assert await peer.hear() == "< error could not open bus >"
    assert await peer.at_end()


async def test_a_frame_sent_just_before_hanging_up_still_goes_out(
    dial: Dial, node: MemoryBus, listen: type[Listener], server: SocketcandServer
):
    heard = listen(node)
    peer = await (await dial()).raw()
    peer.say("< send 000 2 1 0 >")
    peer.writer.close()
    assert await heard.count(1) == [Frame(0x000, b"\x01\x00")]


async def test_a_client_that_reads_nothing_is_cut_off_alone(
    dial: Dial, node: MemoryBus, server: SocketcandServer, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(socketcand, "OUTPUT_LIMIT", 1000)
    slow, good = await (await dial()).raw(), await (await dial()).raw()
    slow.say("< echo >")
    good.say("< echo >")
    assert await good.hear() == "< echo >"
    assert isinstance(slow.writer.transport, asyncio.Transport)
    slow.writer.transport.pause_reading()
    async with asyncio.timeout(30):
        while server.counters.cut_off == 0:
            for _ in range(100):
                node.send(Frame(0x181, bytes(8)))
            for _ in range(100):
                assert (await good.hear()).startswith("< frame 181 ")
    assert server.clients == 1
    node.send(Frame(0x701, b"\x05"))
    assert (await good.hear()).startswith("< frame 701 ")


async def test_a_taken_port_is_said_in_a_sentence(wire: MemoryWire, server: SocketcandServer):
    with pytest.raises(BusError, match=f"can't listen on 127.0.0.1:{server.port}"):
        await SocketcandServer(wire, port=server.port).start()


async def test_closing_disconnects_everyone(dial: Dial, server: SocketcandServer):
    peer = await (await dial()).raw()
    await server.close()
    await server.close()
    assert await peer.at_end()
    assert server.clients == 0


async def test_a_lost_wire_ends_the_connection(
    dial: Dial, server: SocketcandServer, wire: MemoryWire, node: MemoryBus
):
    peer = await (await dial()).raw()
    peer.say("< echo >")
    await peer.hear()
    for port in wire.ports:
        if port is not node:
            port.unplug()
    assert await peer.at_end()
