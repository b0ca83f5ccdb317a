"""What the bus tests share: someone who listens, a wire, and a server on it."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
from bus_listener import Listener

from drivers.bus.memory import MemoryWire
from drivers.sim.socketcand import SocketcandServer


@pytest.fixture
def listen() -> type[Listener]:
    return Listener


@pytest.fixture
def wire() -> MemoryWire:
    return MemoryWire()


@pytest.fixture
async def server(wire: MemoryWire) -> AsyncIterator[SocketcandServer]:
    server = SocketcandServer(wire, port=0)
    await server.start()
    yield server
    await server.close()
