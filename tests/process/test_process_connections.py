"""A server's connections, over real sockets: slow, silent, too many; a stop gets through all of them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from app.configuration.configuration import ServerConfiguration
from app.http.connections import BoundedHttp, bounded_http, look_at

pytestmark = pytest.mark.process

REQUEST = b"POST /api/v1/stop HTTP/1.1\r\nHost: x\r\nContent-Length: 0\r\n\r\n"


async def yes(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body", "body": b""})


@contextlib.asynccontextmanager
async def serving(**configuration: object) -> AsyncIterator[tuple[int, ServerState]]:
    """Just the protocol before an application that says yes; and what it knows of its connections."""
    config = uvicorn.Config(yes, lifespan="off", log_config=None)
    state = ServerState()
    protocol = bounded_http(ServerConfiguration.model_validate(configuration))
    loop = asyncio.get_running_loop()
    server = await loop.create_server(
        lambda: protocol(config=config, server_state=state, app_state={}), "127.0.0.1", 0
    )
    try:
        yield server.sockets[0].getsockname()[1], state
    finally:
        server.close()
        for connection in tuple(state.connections):
            assert isinstance(connection, BoundedHttp)
            connection._unset_keepalive_if_required()
            connection.transport.abort()
        await asyncio.sleep(0)


def later(seconds: float) -> float:
    return asyncio.get_running_loop().time() + seconds


class Client:
    """A TCP client that says what it is told to."""

    def __init__(self, port: int) -> None:
        self._port = port

    async def __aenter__(self) -> Client:
        self.reader, self._writer = await asyncio.open_connection("127.0.0.1", self._port)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._writer.close()
        with contextlib.suppress(ConnectionError):
            await self._writer.wait_closed()

    def say(self, data: bytes) -> None:
        self._writer.write(data)

    async def answer(self) -> bytes:
        """The head of the next answer."""
        return await self.reader.readuntil(b"\r\n\r\n")


@pytest.mark.parametrize("begun", [b"", b"\r\n", b"GET / HTTP/1.1\r\nHost: x\r\n"])
async def test_a_head_that_does_not_end_is_not_waited_for(begun: bytes) -> None:
    async with serving(request_timeout=7) as (port, state), Client(port) as silent, Client(port) as other:
        silent.say(begun)
        other.say(REQUEST)  # it came later: the server knows of both when it is answered
        await other.answer()
        assert len(state.connections) == 2
        look_at(state.connections, later(6))
        assert not any(connection.transport.is_closing() for connection in state.connections)
        look_at(state.connections, later(8))
        assert (await silent.reader.read()).startswith(b"HTTP/1.1 408")
        other.say(REQUEST)
        assert (await other.answer()).startswith(b"HTTP/1.1 204"), (
            "who rests between requests is no slow client"
        )


async def test_a_second_head_must_end_too() -> None:
    async with serving(request_timeout=7) as (port, state), Client(port) as client, Client(port) as other:
        client.say(REQUEST)
        await client.answer()
        client.say(b"GET / HTTP/1.1\r\nHost: x\r\n")
        other.say(REQUEST)
        await other.answer()
        look_at(state.connections, later(8))
        assert (await client.reader.read()).startswith(b"HTTP/1.1 408")


async def test_a_head_that_is_too_large_is_refused() -> None:
    async with serving() as (port, _), Client(port) as client:
        client.say(b"GET / HTTP/1.1\r\n" + b"X-Y: " + b"z" * 40_000)
        assert (await client.answer()).startswith(b"HTTP/1.1 400")


async def test_a_full_house_makes_room_for_a_stop() -> None:
    """Whoever says nothing goes first, the oldest before the younger."""
    async with serving(max_connections=8) as (port, state), contextlib.AsyncExitStack() as stack:
        silent = [await stack.enter_async_context(Client(port)) for _ in range(40)]
        client = await stack.enter_async_context(Client(port))
        client.say(REQUEST)
        assert (await client.answer()).startswith(b"HTTP/1.1 204")
        assert len(state.connections) <= 8
        assert await silent[0].reader.read() == b""
