"""The service as `canaxis serve` starts it, on one end of a wire, and an empty FastAPI route beside it.

    python -m bench.server_process DESCRIPTOR

The empty route is a FastAPI application of its own in the same server and the same event loop, without any of
our middlewares: what a request costs at least here.
"""

from __future__ import annotations

import socket
import sys
import threading
from unittest import mock

from fastapi import FastAPI
from starlette.types import ASGIApp, Receive, Scope, Send

from app import server
from app.commands.logs import configure_logs
from app.configuration.configuration import Configuration
from app.service import Service
from bench.punctual import keep_time
from bench.wire import CHANNEL, as_socketcan

EMPTY = "/bench/empty"
LATE = "/bench/late"
"""Tells how late a thread of this process woke, every 10 ms since it was last asked; at first it is begun."""


class Aside:
    """The service, and an application beside it for one path."""

    def __init__(self, service: ASGIApp, beside: ASGIApp) -> None:
        self._service = service
        self._beside = beside

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """To whom it belongs."""
        chosen = self._beside if scope.get("path") in (EMPTY, LATE) else self._service
        await chosen(scope, receive, send)


def bare() -> FastAPI:
    """An application with an empty route, and one that tells of a thread beside it."""
    app = FastAPI(openapi_url=None)

    @app.get(EMPTY)
    async def empty() -> None: ...

    delays: list[float] = []
    threads: list[threading.Thread] = []

    @app.get(LATE)
    async def late() -> list[float]:
        if not threads:
            arguments = (0.01, delays.append, lambda _: True)
            threads.append(threading.Thread(target=keep_time, args=arguments, daemon=True))
            threads[0].start()
        found = delays.copy()
        delays.clear()
        return found

    return app


async def announce(_: Service, url: str) -> None:
    """Say where."""
    print(url, flush=True)


def main(end: socket.socket) -> None:
    """Serve until a signal comes."""
    configuration = Configuration.model_validate(
        {
            "bus": {"interface": "socketcan", "channel": CHANNEL},
            "server": {"port": 0},
            "network": {"node_heartbeat_ms": 100},
            "log": {"level": "warning"},
        }
    )
    configure_logs(configuration.log)
    real = server.create_app
    with (
        as_socketcan(end),
        mock.patch.object(server, "create_app", lambda *a, **k: Aside(real(*a, **k), bare())),
    ):
        server.run_server(configuration, announce)


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
