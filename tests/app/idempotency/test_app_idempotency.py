"""Idempotency keys, before an application that counts what it carries out."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

import httpx
import pytest
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import Receive, Scope, Send

from app.access.roles import Role, is_stop
from app.access.tokens import Principal
from app.configuration.configuration import Configuration
from app.http.paths import SAFE_METHODS
from app.idempotency.deps import command_headers
from app.idempotency.keys import PRUNE_EACH, Claim, Keys
from app.idempotency.middleware import IdempotencyMiddleware
from app.idempotency.table import names
from app.main import create_app
from app.operations.starting import get_starter
from app.store.database import Database

KEY = {"Idempotency-Key": "k1"}


class Counting:
    """Carries out what it is told, and answers with how often."""

    def __init__(self, status: int = 202, *, spends: bool = True) -> None:
        self.status = status
        self.spends = spends
        self.count = 0
        self.begun = asyncio.Event()
        self.gate = asyncio.Event()
        self.gate.set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await Request(scope, receive).body()
        claim: Claim | None = scope.get("state", {}).get("claim")
        if claim is not None and self.spends:
            await claim.write_down()
        self.count += 1
        count = self.count
        self.begun.set()
        await self.gate.wait()
        if self.status == 0:
            raise RuntimeError("broken")
        response = JSONResponse({"count": count}, self.status, headers={"Location": "/o/1"})
        await response(scope, receive, send)


def client(app: Counting, keys: Keys | None = None) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(IdempotencyMiddleware(app, keys or Keys()))
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


@pytest.mark.parametrize(
    "path", ["/api/v1/stop", "/api/v1/nodes/1/axes/0/stop", "/api/v1/nodes/1/axes/0/quick-stop"]
)
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


async def test_a_request_that_carries_nothing_out_spends_no_key() -> None:
    app = Counting(200, spends=False)
    async with client(app) as http:
        await http.post("/move", headers=KEY)
        again = await http.post("/move", headers=KEY)
    assert app.count == 2
    assert "idempotent-replayed" not in again.headers


async def test_two_clients_with_the_same_key_do_not_meet() -> None:
    app, keys = Counting(), Keys()

    async def of(name: str, scope: Scope, receive: Receive, send: Send) -> None:
        scope["state"] = {"principal": Principal(name, Role.MOVE)}
        await IdempotencyMiddleware(app, keys)(scope, receive, send)

    counts: list[int] = []
    for name in ("anna", "bert", "anna"):
        transport = httpx.ASGITransport(lambda s, r, t, name=name: of(name, s, r, t))
        async with httpx.AsyncClient(transport=transport, base_url="http://x") as http:
            counts.append((await http.post("/move", headers=KEY)).json()["count"])
    assert counts == [1, 2, 1]


async def begun(keys: Keys, key: str, status: int | None = 200) -> Claim:
    """A key that a command took, answered unless the status is None."""
    claim = keys.begin(key, b"f")
    await claim.write_down()
    if status is not None:
        keys.settle(claim, status, [(b"x-a", b"\xe9")], b"answer")
    return claim


async def test_keys_age_and_the_oldest_goes_first_but_never_one_in_flight() -> None:
    now = 0.0
    keys = Keys(capacity=2, lifetime=10, now=lambda: now)
    in_flight = await begun(keys, "a", None)
    for name in ("b", "c", "d"):
        await begun(keys, name)
    assert await keys.find("a") is in_flight.record
    assert await keys.find("b") is None
    assert await keys.find("d") is not None
    now = 11.0
    assert await keys.find("d") is None
    assert await keys.find("a") is in_flight.record


async def test_what_leaves_memory_or_is_of_an_earlier_run_is_found_in_the_store(tmp_path: Path) -> None:
    store = Database(tmp_path / "keys.db")
    await store.open()
    keys = Keys(capacity=1)
    await keys.open(store)
    for name in ("a", "b"):
        await begun(keys, name)
    for later in (keys, Keys()):  # the same run, and the next one
        if later is not keys:
            await later.open(store)
        found = await later.find("a")
        assert found is not None
        assert (found.status, found.headers, found.body) == (200, [(b"x-a", b"\xe9")], b"answer")
    assert found.fingerprint == b"f"
    await store.close()


async def test_a_command_that_was_cut_off_is_never_carried_out_again(tmp_path: Path) -> None:
    store = Database(tmp_path / "keys.db")
    await store.open()
    dying = Keys()
    await dying.open(store)
    await begun(dying, "cut off", None)
    keys = Keys()
    await keys.open(store)
    found = await keys.find("cut off")
    assert found is not None
    assert found.status == 503
    assert b"service_restarted" in found.body
    await store.close()


async def test_a_refusal_frees_the_key_in_the_store_too(tmp_path: Path) -> None:
    store = Database(tmp_path / "keys.db")
    await store.open()
    keys = Keys()
    await keys.open(store)
    await begun(keys, "refused", 409)
    keys.begin("never taken", b"f")
    assert await names(store, 0, 10) == []
    await store.close()


async def test_keys_are_forgotten_by_age_and_by_number(tmp_path: Path) -> None:
    wall = 1e9
    store = Database(tmp_path / "keys.db")
    await store.open()
    keys = Keys(capacity=1, kept=3, wall=lambda: wall)
    await keys.open(store)
    for number in range(600):
        wall += 1
        await begun(keys, str(number))
    kept = [name for name, _ in await names(store, 0, 1000)]
    assert len(kept) <= 3 + PRUNE_EACH
    assert kept[-1] == "599"
    assert await keys.find("0") is None
    wall += 24 * 3600 + 1
    assert await keys.find("597") is None
    await store.close()


async def test_a_store_that_is_off_leaves_keys_in_memory_and_gets_them_when_it_is_back(
    tmp_path: Path,
) -> None:
    path = tmp_path / "not yet" / "keys.db"
    path.parent.write_text("a file where a directory should be")
    store = Database(path, retry=0.01)
    async with AsyncExitStack() as end:
        await store.open()
        end.push_async_callback(store.close)
        assert not store.health.on
        keys = Keys()
        await keys.open(store)
        claim = await begun(keys, "answered")
        await begun(keys, "in flight", None)
        assert await keys.find("answered") is claim.record
        back = asyncio.Event()
        store.on_return.append(back.set)
        path.parent.unlink()
        await asyncio.wait_for(back.wait(), 10)
        following = Keys()
        await following.open(store)
        answered, in_flight = await following.find("answered"), await following.find("in flight")
    assert answered is not None
    assert (answered.fingerprint, answered.status, answered.body) == (b"f", 200, b"answer")
    assert answered.headers == claim.record.headers
    assert in_flight is not None
    assert in_flight.status == 503, "that nobody knows what became of it"


HOLD_NO_KEY = {"issue_ticket", "diff_settings"}
"""Commands that may be carried out any number of times."""


def _depends_on(dependant: Dependant, call: object) -> bool:
    return any(each.call is call or _depends_on(each, call) for each in dependant.dependencies)


def test_every_command_spends_its_key_in_one_way() -> None:
    """With its operation (`Starter`), or before it is carried out (`command_headers`): never both, for two
    writes are slower and no safer, and never neither, for then it would be carried out twice."""
    looked_at = 0
    for route in create_app(Configuration()).routes:
        if not isinstance(route, APIRoute) or (route.methods or set()) <= SAFE_METHODS:
            continue
        if is_stop(route.path) or route.name in HOLD_NO_KEY:
            continue
        looked_at += 1
        ways = [_depends_on(route.dependant, way) for way in (get_starter, command_headers)]
        assert sum(ways) == 1, route.name
    assert looked_at > 8
