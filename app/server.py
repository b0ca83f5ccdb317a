"""The HTTP server: uvicorn, taught to stop the axes before it lets its connections go."""

from __future__ import annotations

import asyncio
import math
import signal
import socket
from collections.abc import Awaitable, Callable
from types import FrameType

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from app.main import create_app
from app.service import Service
from app.settings import Settings, SettingsError

Announce = Callable[[Service, str], Awaitable[None]]
"""Called once the server listens, with the service and the server's URL."""
HERE = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}
"""Where this machine reaches a server that listens on all addresses."""
MAX_HEAD = 32 * 1024
"""Bytes of request line and headers, plus what came with the first of them."""


class BoundedHttp(HttpToolsProtocol):
    """HTTP/1.1 with bounded heads: uvicorn and its parser take them of any length."""

    _in_head = True
    _head = 0

    def on_message_begin(self) -> None:
        """A request begins."""
        super().on_message_begin()
        self._in_head, self._head = True, 0

    def on_headers_complete(self) -> None:
        """The rest is body, which the application bounds."""
        self._in_head = False
        super().on_headers_complete()

    def data_received(self, data: bytes) -> None:
        """Count what belongs to an unfinished head; refuse and hang up when it is too much."""
        began_in_head = self._in_head
        super().data_received(data)
        if began_in_head and self._in_head:
            self._head += len(data)
            if self._head > MAX_HEAD and not self.transport.is_closing():
                self.send_400_response("The head of the request is too large.")


class AxisServer(uvicorn.Server):
    """On the first signal the axes are told to stop at once, and new commands are refused.

    Then requests may end. The lifespan ramps down what still moves and disables it. A second signal leaves
    without that: the modules stop by themselves when our heartbeat ends.
    """

    def __init__(self, settings: Settings, announce: Announce, url: str) -> None:
        super().__init__(_config(create_app(settings, on_service=self.attach), settings))
        self.service: Service | None = None
        self.failed = False
        self._announce = announce
        self._url = url
        self._announcement: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then say so."""
        self._loop = asyncio.get_running_loop()
        await super().startup(sockets)
        if self.started and self.service is not None:
            self._announcement = asyncio.ensure_future(self._announce(self.service, self._url))

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End what was begun here, then as uvicorn does."""
        if self.service is not None:
            self.service.begin_shutdown()
        if self._announcement is not None:
            self._announcement.cancel()
            await asyncio.gather(self._announcement, return_exceptions=True)
        await super().shutdown(sockets)

    def attach(self, service: Service) -> None:
        """The lifespan has begun: this is whom to tell of signals, and who tells of its failure."""
        self.service = service
        service.on_failure = self._on_failure

    def _on_failure(self) -> None:
        self.failed = True
        self.should_exit = True

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """A signal came. It is not raised again at the end: a stop that was asked for is no failure."""
        del sig, frame
        if self.should_exit:
            self.force_exit = True
            return
        self.should_exit = True
        if self.service is not None and self._loop is not None:
            self._loop.call_soon_threadsafe(self.service.begin_shutdown)


def listen(host: str, port: int) -> socket.socket:
    """A socket bound to the address. Raises `SettingsError` if it can't be had."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, kind, protocol, _, address = found[0]
        bound = socket.socket(family, kind, protocol)
    except OSError as error:
        raise SettingsError(
            f"server.host: {host} is no address of this machine ({error.strerror})"
        ) from error
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
        bound.listen(128)
    except OSError as error:
        bound.close()
        raise SettingsError(
            f"server.port: can't listen on {host}:{port} ({error.strerror}); choose another with --port"
        ) from error
    bound.setblocking(False)
    return bound


def run_server(settings: Settings, announce: Announce) -> bool:
    """Serve until a signal comes; True if all went well. Raises `SettingsError` before anything runs."""
    settings.check_exposure()
    bound = listen(settings.server.host, settings.server.port)
    port = int(bound.getsockname()[1])
    settings = settings.model_copy(update={"server": settings.server.model_copy(update={"port": port})})
    host = f"[{settings.server.host}]" if ":" in settings.server.host else settings.server.host
    url = f"http://{HERE.get(host, host)}:{port}"
    with bound:
        server = AxisServer(settings, announce, url)
        closed: signal.Signals | None = getattr(signal, "SIGHUP", None)  # not on Windows
        if closed is not None and signal.getsignal(closed) is signal.SIG_DFL:  # `nohup` ignores it
            signal.signal(closed, server.handle_exit)  # the terminal was closed
        server.run(sockets=[bound])
    return server.started and not server.failed


def _config(app: FastAPI, settings: Settings) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        lifespan="on",
        ws="none",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        http=BoundedHttp,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=math.ceil(settings.server.stop_timeout),
    )
