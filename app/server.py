"""The HTTP server: uvicorn, taught to stop the axes before it lets its connections go."""

from __future__ import annotations

import asyncio
import contextlib
import math
import signal
import socket
from collections.abc import Awaitable, Callable
from types import FrameType

import uvicorn
from fastapi import FastAPI

from app.configuration.configuration import Configuration
from app.configuration.sections import ConfigurationError
from app.http.connections import MAX_MESSAGE, PING, BoundedWebSocket, bounded_http, look_at
from app.main import create_app
from app.service import Service

Announce = Callable[[Service, str], Awaitable[None]]
"""Called once the server listens, with the service and the server's URL."""
HERE = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}
"""Where this machine reaches a server that listens on all addresses."""
DATE = 1.0
"""Seconds between two updates of the Date header, and two looks at the connections."""


class AxisServer(uvicorn.Server):
    """On the first signal the axes are told to stop at once, and new commands are refused.

    Then requests may end. The lifespan ramps down what still moves and disables it. A second signal leaves
    without that: the modules stop by themselves when our heartbeat ends.
    """

    def __init__(self, configuration: Configuration, announce: Announce, url: str) -> None:
        super().__init__(_config(create_app(configuration, on_service=self.attach), configuration))
        self.service: Service | None = None
        self.failed = False
        self._announce = announce
        self._url = url
        self._announcement: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ending = asyncio.Event()
        self._forced = asyncio.Event()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then say so."""
        self._loop = asyncio.get_running_loop()
        await super().startup(sockets)
        if self.started and self.service is not None:
            self._announcement = asyncio.ensure_future(self._announce(self.service, self._url))

    async def main_loop(self) -> None:
        """As uvicorn's, which wakes up ten times a second to see whether it is to end; this one is told."""
        while not await self.on_tick(0):
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(DATE):
                    await self._ending.wait()

    async def on_tick(self, counter: int) -> bool:
        """As uvicorn's; looks at the connections too."""
        look_at(self.server_state.connections, asyncio.get_running_loop().time())
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End what was begun here, then as uvicorn does, until a second signal comes.

        uvicorn heeds that only while requests end; but it is the motors that take their time to come to rest.
        """
        if self.service is not None:
            self.service.begin_shutdown()
        if self._announcement is not None:
            self._announcement.cancel()
            await asyncio.gather(self._announcement, return_exceptions=True)
        orderly = asyncio.ensure_future(super().shutdown(sockets))
        forced = asyncio.ensure_future(self._forced.wait())
        await asyncio.wait((orderly, forced), return_when=asyncio.FIRST_COMPLETED)
        forced.cancel()
        if not orderly.done():
            orderly.cancel()
        await asyncio.gather(orderly, forced, return_exceptions=True)
        if not orderly.cancelled():
            await orderly

    def attach(self, service: Service) -> None:
        """The lifespan has begun: this is whom to tell of signals, and who tells of its failure."""
        self.service = service
        service.on_failure = self._on_failure

    def _on_failure(self) -> None:
        self.failed = True
        self.should_exit = True
        self._ending.set()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """A signal came. It is not raised again at the end: a stop that was asked for is no failure."""
        del sig, frame
        if self.should_exit:
            self.force_exit = True
            if self._loop is not None:
                self._loop.call_soon_threadsafe(self._forced.set)
            return
        self.should_exit = True
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._ending.set)
            if self.service is not None:
                self._loop.call_soon_threadsafe(self.service.begin_shutdown)


def listen(host: str, port: int) -> socket.socket:
    """A socket bound to the address. Raises `ConfigurationError` if it can't be had."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, kind, protocol, _, address = found[0]
        bound = socket.socket(family, kind, protocol)
    except OSError as error:
        raise ConfigurationError(
            f"server.host: {host} is no address of this machine ({error.strerror})"
        ) from error
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
        bound.listen(128)
    except OSError as error:
        bound.close()
        raise ConfigurationError(
            f"server.port: can't listen on {host}:{port} ({error.strerror}); choose another with --port"
        ) from error
    bound.setblocking(False)
    return bound


def run_server(configuration: Configuration, announce: Announce) -> bool:
    """Serve until a signal comes; True if all went well. Raises `ConfigurationError` before anything runs."""
    configuration.check_exposure()
    bound = listen(configuration.server.host, configuration.server.port)
    port = int(bound.getsockname()[1])
    configuration = configuration.model_copy(
        update={"server": configuration.server.model_copy(update={"port": port})}
    )
    host = f"[{configuration.server.host}]" if ":" in configuration.server.host else configuration.server.host
    url = f"http://{HERE.get(host, host)}:{port}"
    with bound:
        server = AxisServer(configuration, announce, url)
        closed: signal.Signals | None = getattr(signal, "SIGHUP", None)  # not on Windows
        if closed is not None and signal.getsignal(closed) is signal.SIG_DFL:  # `nohup` ignores it
            signal.signal(closed, server.handle_exit)  # the terminal was closed
        server.run(sockets=[bound])
    return server.started and not server.failed


def _config(app: FastAPI, configuration: Configuration) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        lifespan="on",
        ws=BoundedWebSocket,
        ws_max_size=MAX_MESSAGE,
        ws_ping_interval=PING,
        ws_ping_timeout=PING,
        ws_per_message_deflate=False,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        http=bounded_http(configuration.server),
        timeout_keep_alive=30,
        timeout_graceful_shutdown=math.ceil(configuration.server.stop_timeout),
    )
