"""Idempotency keys, before an application that counts what it carries out."""

from __future__ import annotations

import asyncio

import httpx
import pytest
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import Receive, Scope, Send

from app.idempotency import IdempotencyMiddleware, MemoryKeys

KEY = {"Idempotency-Key": "k1"}


class Counting:
    """Carries out what it is told, and answers with how often."""

    def __init__(self, status: int = 202) -> None:
        self.status = status
        self.count = 0
        self.begun = asyncio.Event()
        self.gate = asyncio.Event()
        self.gate.set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await Request(scope, receive).body()
        self.count += 1
        count = self.count
        self.begun.set()
        await self.gate.wait()
        if self.status == 0:
            raise RuntimeError("broken")
        response = JSONResponse({"count": count}, self.status, headers={"Location": "/o/1"})
        await response(scope, receive, send)


def client(app: Counting, keys: MemoryKeys | None = None) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(IdempotencyMiddleware(app, keys or MemoryKeys()))
    return httpx.AsyncClient(transport=transport, base_url="http://x")


async def test_the_same_request_is_answered_from_memory() -> None:
    app = Counting()
    async with client(app) as http:
        first = await http.post("/move", content=b"{}", headers=KEY)
        second = await http.post("/move", content=b"{}", headers=KEY)
    assert app.count == 1
    assert (second.status_code, second.json()) == (202, {"count": 1})
    assert second.headers["location"] == "/o/1"
    assert second.headers["idempotent-replayed"] == "true"
    assert "idempotent-replayed" not in first.headers


@pytest.mark.parametrize(("path", "body"), [("/move", b'{"a":1}'), ("/home", b"{}"), ("/move?wait=1", b"{}")])
async def test_another_request_with_the_same_key_is_refused(path: str, body: bytes) -> None:
    app = Counting()
    async with client(app) as http:
        await http.post("/move", content=b"{}", headers=KEY)
        response = await http.post(path, content=body, headers=KEY)
    assert response.status_code == 422
    assert response.json()["code"] == "key_reused"
    assert app.count == 1


async def test_while_the_first_is_in_flight_the_second_is_refused() -> None:
    app = Counting()
    app.gate.clear()
    async with client(app) as http:
        first = asyncio.create_task(http.post("/move", content=b"{}", headers=KEY))
        await app.begun.wait()
        second = await http.post("/move", content=b"{}", headers=KEY)
        app.gate.set()
        assert (await first).status_code == 202
    assert (second.status_code, second.json()["code"]) == (409, "key_in_flight")
    assert app.count == 1


@pytest.mark.parametrize("status", [404, 409, 422, 503])
async def test_what_was_refused_leaves_the_key_free(status: int) -> None:
    app = Counting(status)
    async with client(app) as http:
        await http.post("/move", headers=KEY)
        app.status = 202
        assert (await http.post("/move", headers=KEY)).json() == {"count": 2}


@pytest.mark.parametrize("status", [200, 502, 504])
async def test_what_had_begun_is_not_carried_out_again(status: int) -> None:
    app = Counting(status)
    async with client(app) as http:
        await http.post("/move", headers=KEY)
        assert (await http.post("/move", headers=KEY)).status_code == status
    assert app.count == 1


async def test_what_broke_off_is_not_carried_out_again() -> None:
    app = Counting(0)
    async with client(app) as http:
        with pytest.raises(RuntimeError):
            await http.post("/move", headers=KEY)
        assert (await http.post("/move", headers=KEY)).status_code == 500
    assert app.count == 1


@pytest.mark.parametrize("path", ["/api/v1/stop", "/api/v1/nodes/1/axes/0/stop", "/a/quick-stop"])
async def test_a_stop_is_always_carried_out(path: str) -> None:
    app = Counting(200)
    async with client(app) as http:
        await http.post(path, headers=KEY)
        await http.post(path, headers=KEY)
    assert app.count == 2


async def test_a_key_that_is_too_long_or_empty_is_refused() -> None:
    app = Counting()
    async with client(app) as http:
        for key in ("", "x" * 256):
            assert (await http.post("/move", headers={"Idempotency-Key": key})).status_code == 422
    assert app.count == 0


async def test_reading_needs_no_key() -> None:
    app = Counting(200)
    async with client(app) as http:
        await http.get("/x", headers=KEY)
        await http.get("/x", headers=KEY)
    assert app.count == 2


def test_keys_age_and_the_oldest_goes_first_but_never_one_in_flight() -> None:
    now = 0.0
    keys = MemoryKeys(capacity=2, lifetime=10, now=lambda: now)
    in_flight = keys.begin("a", b"")
    for name in ("b", "c", "d"):
        keys.begin(name, b"").status = 200
    assert keys.find("a") is in_flight
    assert keys.find("b") is None
    assert keys.find("d") is not None
    now = 11.0
    assert keys.find("d") is None
    assert keys.find("a") is in_flight
