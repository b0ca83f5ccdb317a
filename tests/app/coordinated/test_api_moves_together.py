"""Several axes moved together over HTTP."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from api_bench import Bench

pytestmark = pytest.mark.looptime

PATH = "/moves"


def body(*targets: int, **more: Any) -> dict[str, Any]:
    axes = [
        {"node": "stage", "axis": number, "target": target, "unit": "steps"}
        for number, target in enumerate(targets)
    ]
    return {"targets": axes, **more}


async def enable(bench: Bench) -> None:
    for number in range(3):
        response = await bench.post(f"/nodes/1/axes/{number}/enable")
        assert response.status_code == 200, response.text


async def test_three_axes_are_one_operation_with_their_arrivals(bench: Bench) -> None:
    await enable(bench)
    response = await bench.post(f"{PATH}?wait=60", json=body(51_200, -20_000, 0))
    assert response.status_code == 200, response.text
    done = response.json()
    assert (done["kind"], done["state"], done["axis"]) == ("coordinated_move", "succeeded", None)
    assert [axis["axis"] for axis in done["axes"]] == [0, 1, 2]
    result = done["result"]
    assert result["spread_s"] < 0.02
    assert done["predicted_s"] == result["predicted_s"]
    assert result["duration_s"] == pytest.approx(result["predicted_s"], abs=0.05)
    assert [axis["position"]["steps"] for axis in result["axes"]] == [51_200, -20_000, 0]
    assert result["axes"][2]["arrived_s"] is None
    assert [track["end"]["steps"] for track in done["evidence"]["axes"]] == [51_200, -20_000, 0]


async def test_while_it_runs_each_axis_is_busy_and_its_cancelling_stops_all(bench: Bench) -> None:
    await enable(bench)
    operation = (await bench.post(PATH, json=body(300_000, 100_000, 0))).json()
    await asyncio.sleep(0.5)
    for number in range(3):
        axis = (await bench.get(f"/nodes/1/axes/{number}")).json()
        assert axis["operation"] == operation["id"]
        busy = await bench.post(f"/nodes/1/axes/{number}/move", json={"target": 1, "unit": "steps"})
        assert (busy.status_code, busy.json()["code"]) == (409, "axis_busy")
        assert 1 <= int(busy.headers["retry-after"]) <= operation["predicted_s"] + 1
    cancelled = (await bench.post(operation["links"]["cancel"].removeprefix("/api/v1"))).json()
    assert cancelled["state"] == "cancelled"
    for number in range(3):
        assert not (await bench.get(f"/nodes/1/axes/{number}")).json()["moving"]


async def test_a_dry_run_says_what_each_axis_would_do_and_sends_nothing(bench: Bench) -> None:
    await enable(bench)
    await bench.post("/nodes/1/axes/1/disable")
    wanted = body(51_200, 25_600, 0, duration_s=4.0)
    sent: list[int] = []
    bench.wire.tap(lambda port, frame: sent.append(frame.cob_id) if port == "master" else None)
    for _ in range(2):  # it spends no key
        response = await bench.post(f"{PATH}?dry_run=true", json=wanted, headers={"Idempotency-Key": "k"})
        assert response.status_code == 200, response.text
        assert "idempotent-replayed" not in response.headers
    assert all(cob_id >= 0x700 for cob_id in sent), "heartbeats at most"
    said = response.json()
    assert (said["dry_run"], said["ready"], said["predicted_s"]) == (True, False, 4.0)
    assert said["axes"][0]["velocity"]["steps"] > said["axes"][1]["velocity"]["steps"]
    assert said["axes"][2]["velocity"] is None
    path = said["axes"][0]["path"]
    assert (path["lowest"]["steps"], path["highest"]["steps"], path["within"]) == (0, 51_200, True)
    told = {write["index"]: write["new"] for write in said["axes"][0]["writes"]}
    assert told["0x6081"] == said["axes"][0]["velocity"]["steps"]
    assert said["axes"][2]["writes"] == []
    assert [o["code"] for o in said["axes"][1]["obstacles"]] == ["not_enabled"]
    assert (await bench.get("/operations")).json()["operations"] == []


async def test_what_prevents_one_axis_is_said_of_each(bench: Bench) -> None:
    await bench.post("/nodes/1/axes/0/enable")
    refused = await bench.post(PATH, json=body(1, 2, 3))
    assert (refused.status_code, refused.json()["code"]) == (409, "not_ready")
    assert len(refused.json()["obstacles"]) == 2
    unknown = await bench.post(
        PATH, json={"targets": [{"node": "stage", "axis": "w", "target": 1, "unit": "steps"}]}
    )
    assert (unknown.status_code, unknown.json()["code"]) == (404, "unknown_axis")
    assert (await bench.post(PATH, json={"targets": []})).status_code == 422
