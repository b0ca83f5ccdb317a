"""What the API's tests stand on: `running` gives a service, a client and the simulated module behind it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any

import httpx
from fastapi import FastAPI
from starlette.types import Message, Receive, Scope, Send

from app.configuration.configuration import Configuration
from app.main import create_app
from app.service import Service
from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.devices.catalog import Catalog
from drivers.master import Axis, Motion, MotionKind, MoveRequest
from drivers.master.seen.status import NodeState
from drivers.sim.module import SimulatedModule
from drivers.sim.runner import SimulatedNode

URL = "http://127.0.0.1:8402"
PROFILE = Catalog.load().profile("TMCM-3216")
App = Callable[[Scope, Receive, Send], Coroutine[Any, Any, None]]


@dataclass
class Bench:
    """One running service."""

    configuration: Configuration
    wire: MemoryWire
    master_port: MemoryBus
    module: SimulatedNode
    service: Service
    app: App
    client: httpx.AsyncClient

    async def until_ready(self) -> None:
        """Wait until every node is operational and every axis's status is fresh."""
        await self.until(
            lambda: all(
                node.status().state is NodeState.OPERATIONAL and not any(a.status.stale for a in node.axes)
                for node in self.service.network.nodes.values()
            )
        )

    async def until(self, condition: Callable[[], bool], within: float = 30.0) -> None:
        """Wait until something is true, looking at each event."""
        events = self.service.network.events.subscribe()
        try:
            async with asyncio.timeout(within):
                while not condition():
                    await events.get()
        finally:
            events.close()

    async def get(self, path: str, **kwargs: Any) -> httpx.Response:
        """GET below /api/v1."""
        return await self.client.get(f"/api/v1{path}", **kwargs)

    async def post(self, path: str, body: object = None, **kwargs: Any) -> httpx.Response:
        """POST below /api/v1, with the JSON content type, body or not."""
        headers = {"Content-Type": "application/json"} | dict(kwargs.pop("headers", {}))
        content = None if body is None else json.dumps(body)
        return await self.client.post(f"/api/v1{path}", content=content, headers=headers, **kwargs)

    async def put(self, path: str, body: object, **kwargs: Any) -> httpx.Response:
        """PUT below /api/v1."""
        return await self.client.put(f"/api/v1{path}", json=body, **kwargs)

    async def axis(self, axis: str = "0") -> dict[str, Any]:
        """The status of an axis."""
        return (await self.get(f"/nodes/1/axes/{axis}")).json()

    async def enable(self, *axes: str) -> None:
        """Enable axes; 0 if none is named."""
        for axis in axes or ("0",):
            response = await self.post(f"/nodes/1/axes/{axis}/enable")
            assert response.status_code == 200, response.text

    async def move(self, target: int, *, axis: str = "0", wait: float = 0, **more: Any) -> httpx.Response:
        """Move to a position in steps."""
        body = {"target": target, "unit": "steps", **more}
        return await self.post(f"/nodes/1/axes/{axis}/move?wait={wait}", body)

    async def until_moving(self, axis: int = 0) -> None:
        """Wait until the motor turns."""
        status = self.service.network.node(1).axis(axis)
        await self.until(lambda: status.status.moving)


def never_begun(axis: Axis) -> Motion:
    """A move that was accepted, as an operation sees one, and that nobody carries out."""

    async def stop(motion: Motion, reason: str) -> None:
        motion.give_up(reason)

    return Motion(MotionKind.MOVE, axis.tools, MoveRequest(0), lambda _: None, stop)


@asynccontextmanager
async def running(
    configuration: Configuration | None = None, *, powered: bool = True, plugged: bool = True
) -> AsyncIterator[Bench]:
    """A service on a wire with a simulated module, or with one that is not there yet."""
    configuration = configuration or Configuration()
    wire = MemoryWire(bit_rate=1_000_000)
    master_port = wire.port("master")
    if not plugged:
        master_port.unplug()
    module = SimulatedNode(SimulatedModule(PROFILE, 1), wire.port("node 1"))
    services: list[Service] = []
    app: FastAPI = create_app(configuration, master_port, on_service=services.append)
    async with AsyncExitStack() as stack:
        if powered:
            await stack.enter_async_context(module)
        state = await stack.enter_async_context(app.router.lifespan_context(app))
        assert state is not None
        (service,) = services

        async def with_state(scope: Scope, receive: Receive, send: Send) -> None:
            await app({**scope, "state": dict(state)}, receive, send)

        client = await stack.enter_async_context(
            httpx.AsyncClient(transport=httpx.ASGITransport(with_state), base_url=URL)
        )
        yield Bench(configuration, wire, master_port, module, service, with_state, client)


@dataclass
class ServerEvent:
    """One event of a stream."""

    kind: str
    id: int | None
    data: Any


class EventClient:
    """A browser's EventSource, as far as the tests need it, on the bare ASGI application."""

    def __init__(self, app: App, *, last_event_id: str | None = None) -> None:
        self._app = app
        self._headers = [(b"host", b"127.0.0.1:8402")]
        if last_event_id is not None:
            self._headers.append((b"last-event-id", last_event_id.encode()))
        self._chunks: asyncio.Queue[bytes | None] = asyncio.Queue()
        self._gone = asyncio.Event()
        self._text = ""
        self._task: asyncio.Task[None] | None = None
        self.status: int | None = None
        self.headers: dict[bytes, bytes] = {}
        self.comments = 0

    def scope(self) -> dict[str, Any]:
        """The request as a server hands it to the application."""
        return {
            "type": "http", "asgi": {"version": "3.0", "spec_version": "2.3"}, "http_version": "1.1",
            "method": "GET", "scheme": "http", "path": "/api/v1/events", "raw_path": b"/api/v1/events",
            "root_path": "", "query_string": b"", "headers": self._headers,
            "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 8402),
        }  # fmt: skip

    async def __aenter__(self) -> EventClient:
        self._task = asyncio.create_task(self._run(self.scope()))
        return self

    async def __aexit__(self, *_: object) -> None:
        self._gone.set()
        assert self._task is not None
        await asyncio.wait_for(self._task, 60)

    async def _run(self, scope: Scope) -> None:
        asked = False

        async def receive() -> Message:
            nonlocal asked
            if not asked:
                asked = True
                return {"type": "http.request", "body": b"", "more_body": False}
            await self._gone.wait()
            return {"type": "http.disconnect"}

        async def send(message: Message) -> None:
            if message["type"] == "http.response.start":
                self.status = message["status"]
                self.headers = dict(message["headers"])
            else:
                self._chunks.put_nowait(message.get("body", b""))

        try:
            await self._app(scope, receive, send)
        finally:
            self._chunks.put_nowait(None)

    async def next(self, *kinds: str, within: float = 30.0) -> ServerEvent:
        """The next event of one of these kinds (any if none is named); fails if the stream ends."""
        async with asyncio.timeout(within):
            while True:
                event = self._parse()
                if event is None:
                    chunk = await self._chunks.get()
                    assert chunk is not None, "the stream ended"
                    self._text += chunk.decode()
                elif not kinds or event.kind in kinds:
                    return event

    async def ended(self, within: float = 30.0) -> bool:
        """Whether the stream ends in time; what still comes is dropped."""
        async with asyncio.timeout(within):
            while await self._chunks.get() is not None:
                pass
        return True

    def _parse(self) -> ServerEvent | None:
        while "\n\n" in self._text:
            block, self._text = self._text.split("\n\n", 1)
            fields = dict(line.split(": ", 1) for line in block.split("\n") if not line.startswith(":"))
            if "event" in fields:
                number = fields.get("id")
                return ServerEvent(
                    fields["event"], None if number is None else int(number), json.loads(fields["data"])
                )
            self.comments += block.startswith(":")
        return None
