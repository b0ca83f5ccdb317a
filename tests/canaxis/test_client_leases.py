"""Leases of the Python client: on the service itself without a socket, and on scripted answers."""

from __future__ import annotations

import threading
from collections.abc import Callable
from queue import Queue
from types import SimpleNamespace

import httpx
import pytest
from api_bench import URL, Bench

from canaxis import AsyncClient, Client, Leased, LeaseLost, Patience

GRANTED = {"id": "a1", "token": "secret", "fencing": 17, "owner": "anna"}
STATUS = {"id": "a1", "owner": "anna", "expires_in_s": 1.0}
LOST = {"code": "lease_lost", "status": 423, "detail": "Not held.", "hint": "Take a new one."}


class Scripted:
    """A service of leases; `renew` answers renewals."""

    def __init__(self, renew: Callable[[], httpx.Response]) -> None:
        self.sent: list[httpx.Request] = []
        self.renewed = threading.Event()
        self._renew = renew
        self.client = Client(
            "http://service.example",
            http=httpx.Client(transport=httpx.MockTransport(self._answer)),
            patience=Patience(0),
        )

    def _answer(self, request: httpx.Request) -> httpx.Response:
        self.sent.append(request)
        if request.url.path.endswith("/renew"):
            answer = self._renew()
            self.renewed.set()
            return answer
        if request.url.path.endswith("/leases"):
            return httpx.Response(201, json=GRANTED)
        return httpx.Response(200, json=STATUS)


def test_it_is_renewed_in_the_background_and_released_with_its_token() -> None:
    scripted = Scripted(lambda: httpx.Response(200, json=STATUS))
    with scripted.client.lease(("stage", "x"), ttl=0.03) as lease:
        assert scripted.renewed.wait(10)
        assert not lease.lost
    taken, *rest = scripted.sent
    assert "lease" not in taken.headers
    assert {request.headers["lease"] for request in rest} == {"secret"}
    assert rest[-1].url.path == "/api/v1/leases/a1/release"
    assert rest[-1].content == b'{"stop":false}'
    assert all("lease-" not in thread.name for thread in threading.enumerate())


def test_an_exception_that_leaves_it_stops_what_runs() -> None:
    scripted = Scripted(lambda: httpx.Response(200, json=STATUS))
    with pytest.raises(KeyError), scripted.client.lease(("stage", "x")):
        raise KeyError
    assert scripted.sent[-1].content == b'{"stop":true}'


def test_once_it_is_lost_the_next_command_says_so_and_is_not_sent() -> None:
    scripted = Scripted(lambda: httpx.Response(423, json=LOST))
    with scripted.client.lease(("stage", "x"), ttl=0.03) as lease:
        assert scripted.renewed.wait(10)
        lease._renewing.join(10)
        assert lease.lost
        before = len(scripted.sent)
        with pytest.raises(LeaseLost):
            lease.node("stage").axis("x").enable()
        assert len(scripted.sent) == before


def test_one_that_could_not_be_renewed_is_lost_when_its_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    now, ttl = 100.0, 0.03
    monkeypatch.setattr("canaxis.blocking.client.time", SimpleNamespace(monotonic=lambda: now))
    failures: Queue[None] = Queue()

    def unreachable() -> httpx.Response:
        failures.put(None)
        raise httpx.ConnectError("no route")

    scripted = Scripted(unreachable)
    with scripted.client.lease(("stage", "x"), ttl=ttl) as lease:
        for _ in range(2):  # the second is tried only after the first was found to be no loss
            failures.get(timeout=10)
        assert not lease.lost, "the next renewal may be in time still"
        now += ttl
        lease._renewing.join(10)
        assert lease.lost
        before = len(scripted.sent)
        with pytest.raises(LeaseLost):
            lease.node("stage").axis("x").enable()
        assert len(scripted.sent) == before


async def test_on_the_service_the_holder_commands_and_nobody_else(bench: Bench) -> None:
    async with AsyncClient(URL, http=bench.client) as client:
        async with client.lease(("stage", "x"), owner="anna") as lease:
            assert (await lease.node("stage").axis("x").enable()).state == "operation_enabled"
            with pytest.raises(Leased) as refused:
                await client.node("stage").axis("x").disable()
            assert refused.value.owner == "anna"
            assert refused.value.expires_in_s is not None
            with pytest.raises(Leased):
                async with client.lease(("stage", "x")):
                    pass
            async with client.lease(("stage", "x"), owner="bert", force=True):
                with pytest.raises(LeaseLost):
                    await lease.node("stage").axis("x").enable()
                await lease.node("stage").axis("x").stop()
        await client.node("stage").axis("x").disable()
