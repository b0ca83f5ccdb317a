"""The HTTP server: uvicorn, taught to stop the axes before it lets its connections go."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Awaitable, Callable
from types import FrameType

import uvicorn
from fastapi import FastAPI

from app.main import create_app
from app.service import Service
from app.settings import Settings, SettingsError

Announce = Callable[[Service, str], Awaitable[None]]
"""Called once the server listens, with the service and the server's URL."""


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
    url = f"http://{'127.0.0.1' if host == '0.0.0.0' else host}:{port}"
    with bound:
        server = AxisServer(settings, announce, url)
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
        h11_max_incomplete_event_size=32 * 1024,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=math.ceil(settings.server.stop_timeout),
    )
