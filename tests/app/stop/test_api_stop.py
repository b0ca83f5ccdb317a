"""The stop for everything: always allowed, latched, reset on purpose."""

from __future__ import annotations

import asyncio

import pytest
from api_bench import Bench, running

pytestmark = pytest.mark.looptime


async def test_it_stops_every_axis_and_latches(bench: Bench) -> None:
    await bench.enable("0", "1", "2")
    moves = [(await bench.move(10_000_000, axis=axis)).json() for axis in "012"]
    for axis in range(3):
        await bench.until_moving(axis)
    response = await bench.post("/stop", {"reason": "A hand is in the way."})
    assert response.status_code == 200
    report = response.json()
    assert report["latched"] is True
    assert report["complete"] is True
    assert [a["outcome"] for a in report["axes"]] == ["stopped"] * 3
    for axis, move in zip("012", moves, strict=True):
        assert (await bench.axis(axis))["moving"] is False
        operation = (await bench.get(f"/operations/{move['id']}")).json()
        assert operation["state"] == "cancelled"
        assert "hand" in operation["reason"]


async def test_nothing_moves_until_it_is_reset(bench: Bench) -> None:
    await bench.enable()
    await bench.post("/stop", {"reason": "lunch"})
    state = (await bench.get("/stop")).json()
    assert (state["latched"], state["reason"]) == (True, "lunch")
    for command, body in (
        ("move", {"target": 1, "unit": "steps"}),
        ("velocity", {"velocity": 1000, "unit": "steps"}),
        ("home", {"method": 19}),
        ("enable", None),
    ):
        refused = await bench.post(f"/nodes/1/axes/0/{command}", body)
        assert refused.status_code == 409, command
        assert refused.json()["code"] == "stop_latched"
        assert "/api/v1/stop/reset" in refused.json()["hint"]
    assert (await bench.post("/stop/reset")).json() == {"latched": False, "reason": None, "time": None}
    assert (await bench.axis())["moving"] is False, "nothing starts by itself"
    assert (await bench.move(100, wait=30)).json()["state"] == "succeeded"


async def test_it_needs_no_body_and_no_content_type(bench: Bench) -> None:
    response = await bench.client.post("/api/v1/stop")
    assert response.status_code == 200
    assert response.json()["reason"]


@pytest.mark.parametrize("body", [{"reason": ""}, {"reason": 7}, {"reason": "x" * 201}, {"because": "x"}, []])
async def test_a_bad_body_is_refused(bench: Bench, body: object) -> None:
    assert (await bench.post("/stop", body)).status_code == 422


async def test_it_says_which_axes_it_could_not_reach() -> None:
    async with running(powered=False) as bench:
        response = await bench.post("/stop", {"reason": "test"})
        assert response.status_code == 200
        assert response.json()["complete"] is False
        assert {a["outcome"] for a in response.json()["axes"]} == {"unreachable"}


async def test_it_overtakes_a_waiting_client(bench: Bench) -> None:
    await bench.enable()
    waiting = asyncio.create_task(bench.move(10_000_000, wait=600))
    await bench.until_moving()
    await bench.post("/stop")
    answer = await waiting
    assert answer.status_code == 200
    assert answer.json()["state"] == "cancelled"
