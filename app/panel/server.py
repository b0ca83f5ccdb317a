"""The panel's HTTP server, in the loop of the simulator."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager

import uvicorn

from app.panel.application import create_panel
from app.server import listen
from drivers.sim.station import Station

HOST = "127.0.0.1"
"""The only address that it is served on: whoever reaches it may do anything to the modules."""
ENDING = 1
"""Seconds that open requests get at the end."""


class _Server(uvicorn.Server):
    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        """Signals are the simulator's business: it ends this server itself."""
        yield


@asynccontextmanager
async def panel_server(station: Station, port: int) -> AsyncGenerator[str]:
    """The panel on `port` (0 takes a free one); gives its URL. Raises `ConfigurationError` without one."""
    with listen(HOST, port) as bound:
        actual = int(bound.getsockname()[1])
        config = uvicorn.Config(
            create_panel(station, actual),
            lifespan="off",
            ws="none",
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=ENDING,
        )
        server = _Server(config)
        serving = asyncio.create_task(server.serve(sockets=[bound]), name="fault panel")
        try:
            yield f"http://{HOST}:{actual}"
        finally:
            server.should_exit = True
            await serving
