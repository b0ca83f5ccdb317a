"""Coordinated moves by the client."""

from __future__ import annotations

import json

import httpx
import pytest
from api_bench import URL, Bench

from app.operations.schemas import OPERATION
from canaxis import AsyncClient, Client
from canaxis.contract.options import Target

TARGETS: tuple[Target, ...] = (
    {"node": "stage", "axis": 0, "target": 20_000, "unit": "steps"},
    {"node": 1, "axis": "1", "target": -3000, "unit": "steps", "relative": True, "velocity": 9000},
)


@pytest.mark.looptime
async def test_axes_are_moved_together_and_waited_for(bench: Bench) -> None:
    for number in (0, 1):
        await bench.post(f"/nodes/1/axes/{number}/enable")
    http = httpx.AsyncClient(transport=httpx.ASGITransport(bench.app))
    async with http, AsyncClient(URL, http=http) as client:
        operation = await client.move_together(TARGETS, duration_s=1.5)
        await operation.wait(30)
        assert operation.kind == "coordinated_move"
        assert operation.result is not None
        assert operation.result["duration_s"] == pytest.approx(1.5, abs=0.05)
        assert [axis["position"]["steps"] for axis in operation.result["axes"]] == [20_000, -3000]


def test_the_body_is_what_the_service_takes() -> None:
    sent: list[httpx.Request] = []

    def answer(request: httpx.Request) -> httpx.Response:
        sent.append(request)
        return httpx.Response(202, json=OPERATION)

    http = httpx.Client(transport=httpx.MockTransport(answer))
    client = Client("http://service.example", http=http)
    client.move_together(TARGETS, on_busy="replace", key="a key")
    assert (sent[0].url.path, sent[0].headers["idempotency-key"]) == ("/api/v1/moves", "a key")
    assert json.loads(sent[0].content) == {"targets": list(TARGETS), "on_busy": "replace"}
