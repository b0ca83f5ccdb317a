"""Trajectories over HTTP: JSON and CSV, what is refused and why, and in what memory."""

from __future__ import annotations

import asyncio
import errno
import json
import math
import tracemalloc
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
from api_bench import Bench

from app.configuration.configuration import Configuration
from app.trajectories import routes
from drivers.master.together.trajectory_file import PointFile

pytestmark = pytest.mark.looptime

JSON = {"Content-Type": "application/json"}
CSV = {"Content-Type": "text/csv"}
AXES = [{"node": 1, "axis": 0, "unit": "steps"}, {"node": "stage", "axis": "y", "unit": "steps"}]


def body(**more: Any) -> dict[str, Any]:
    points = [
        {"t": number / 10, "positions": [100 * share, -50 * share], "velocities": [0, 0]}
        for number, share in enumerate((0, 1, 2))
    ]
    return {"axes": AXES, "cycle_ms": 10, "points": points, **more}


async def enabled(bench: Bench) -> None:
    for axis in (0, 1):
        assert (await bench.post(f"/nodes/1/axes/{axis}/enable")).status_code == 200


async def send(bench: Bench, content: Any, query: str = "", **headers: str) -> httpx.Response:
    return await bench.client.post(f"/api/v1/trajectories{query}", content=content, headers=headers)


async def refused(bench: Bench, content: Any, code: str, query: str = "", **headers: str) -> dict[str, Any]:
    response = await send(bench, content, query, **(headers or JSON))
    told: dict[str, Any] = response.json()
    assert (response.headers["content-type"], told["code"]) == ("application/problem+json", code), told
    return told


async def test_json_points_are_followed_and_the_result_tells_how_punctually(bench: Bench) -> None:
    await enabled(bench)
    response = await bench.post("/trajectories?wait=20", body())
    operation = response.json()
    assert response.status_code == 200, operation
    assert operation["state"] == "succeeded", operation
    assert operation["kind"] == "trajectory"
    assert [axis["name"] for axis in operation["axes"]] == ["x", "y"]
    assert operation["request"]["points"] == 3
    result = operation["result"]
    assert (result["cycles"], result["under_runs"], result["sender"]) == (21, 0, "loop")
    assert 0 <= result["lateness_p50_ms"] <= result["lateness_p99_ms"] <= result["lateness_max_ms"]
    assert operation["predicted_s"] == result["duration_s"]
    ends = [axis["end"]["steps"] for axis in operation["evidence"]["axes"]]
    assert ends == [200, -100]


async def test_csv_names_axes_and_units_and_the_query_the_cycle(bench: Bench) -> None:
    await enabled(bench)
    text = (
        "t,1.0[steps],stage.y[steps],1.0.v[steps/s],stage.y.v[steps/s]\r\n0,0,0,0,0\r\n0.2,400,-400,0,0\r\n"
    )
    response = await send(bench, text, "?cycle_ms=20&wait=20", **CSV)
    assert response.json()["state"] == "succeeded", response.json()
    assert response.json()["result"]["cycles"] == 11


async def test_a_dry_run_says_what_it_comes_to_and_begins_nothing(bench: Bench) -> None:
    for _ in range(2):  # it spends no key
        response = await bench.post("/trajectories?dry_run=true", body(), headers={"Idempotency-Key": "k"})
        assert response.status_code == 200
        assert "Idempotent-Replayed" not in response.headers
    forecast = response.json()
    assert (forecast["points"], forecast["cycles"], forecast["duration_s"]) == (3, 21, 0.2)
    x = forecast["axes"][0]
    assert x["highest"]["steps"] == 200
    assert x["peak_velocity"]["unit"] == "steps/s"
    assert 1400 < x["peak_velocity"]["steps"] < 1510  # 1.5 times the mean
    assert (await bench.get("/operations")).json()["operations"] == []


async def test_the_first_point_that_can_not_be_followed_is_named(bench: Bench) -> None:
    await enabled(bench)

    def path(*positions: float, gap: float = 1.0) -> dict[str, Any]:
        points = [{"t": n * gap, "positions": [p], "velocities": [0]} for n, p in enumerate(positions)]
        return {"axes": AXES[:1], "points": points}

    told = await refused(bench, json.dumps(path(0, 100, 90_000)), "trajectory_refused")
    assert (told["point"], told["quantity"], told["axis"]) == (2, "velocity", 0) or told["quantity"] in (
        "acceleration",
        "velocity",
    )
    assert told["point"] == 2
    assert abs(told["value"]) > told["limit"]
    told = await refused(bench, json.dumps(path(500, 600)), "trajectory_refused")
    assert (told["point"], told["quantity"], told["value"], told["limit"]) == (0, "start", 500, 0)
    corner = {"axes": AXES[:1], "points": [{"t": 0, "positions": [0]}, {"t": 1, "positions": [20_000]}]}
    told = await refused(bench, json.dumps(corner), "trajectory_refused")
    assert (told["point"], told["quantity"]) == (1, "acceleration")
    backwards = {"axes": AXES[:1], "points": [{"t": 1, "positions": [0]}, {"t": 1, "positions": [0]}]}
    told = await refused(bench, json.dumps(backwards), "trajectory_refused")
    assert (told["point"], told["quantity"]) == (1, "time")
    assert (await bench.get("/operations")).json()["operations"] == []


NOT_JSON = [
    "",
    "[]",
    "{",
    '{"axes": [], "points": []}',
    '{"points": [{"t": 0, "positions": [0]}, {"t": 1, "positions": [0]}]}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": []}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": true, "positions": [0]}]}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": 0, "positions": [0, 1]}]}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": 0, "positions": ["0"]}]}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": 0, "positions": [1e999]}]}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": 0, "positions": [NaN]}]}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": 0, "positions": [0], "v": 1}]}',
    '{"axes": [{"node": 1, "axis": 0}], "points": [{"t": 0, "positions": [0]}]}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": 0, "positions": [0]}], "x": 1}',
    '{"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": [{"t": 0, "positions": [0]}]} {}',
    '{"cycle_ms": 1.5, "axes": [{"node": 1, "axis": 0, "unit": "steps"}], "points": []}',
]


async def test_what_is_no_such_json_is_said_with_an_example(bench: Bench) -> None:
    for text in NOT_JSON:
        told = await refused(bench, text, "bad_request")
        assert "points" in told["hint"], text


NOT_CSV = [
    "",
    "x,y\n",
    "t,stage.x\n0,0\n",
    "t,stage.x[steps]\n",
    "t,stage.x[steps]\n0\n",
    "t,stage.x[steps]\n0,a\n",
    "t,stage.x[steps]\n0,nan\n",
    "t,stage.x[steps],stage.x[steps]\n0,0,0\n",
    "t,stage.x[steps],stage.y.v[steps/s]\n0,0,0\n",
    "t,stage.x[steps],stage.x.v[mm/s]\n0,0,0\n",
    "t,stage.x[steps]\n" + "1" * 20_000,
    b"t,stage.x[steps]\n0,\xff\n",
]


async def test_what_is_no_such_csv_is_said_with_an_example(bench: Bench) -> None:
    for text in NOT_CSV:
        told = await refused(bench, text, "bad_request", **CSV)
        assert "stage.x[mm]" in told["hint"], text


async def test_what_names_no_axis_or_unit_is_refused(bench: Bench) -> None:
    await refused(bench, "t,stage.q[steps]\n0,0\n1,0\n", "unknown_axis", **CSV)
    await refused(bench, "t,stage.x[furlong]\n0,0\n1,0\n", "bad_value", **CSV)
    await refused(bench, "t,stage.x[steps],1.0[steps]\n0,0,0\n1,0,0\n", "bad_value", **CSV)
    await refused(bench, json.dumps(body(cycle_ms=101)), "bad_value")
    await refused(bench, json.dumps(body()), "bad_request", "?cycle_ms=20")
    await refused(bench, json.dumps(body()), "not_ready")  # nothing is enabled


async def test_a_form_or_a_foreign_page_can_not_post_a_path(bench: Bench) -> None:
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""):
        told = await refused(bench, json.dumps(body()), "media_type_unknown", **{"Content-Type": kind})
        assert told["status"] == 415
    await refused(bench, "t", "forbidden_origin", **CSV, Origin="https://evil.example")
    await refused(bench, "t", "forbidden_origin", **CSV, **{"Sec-Fetch-Site": "cross-site"})


async def test_a_key_is_for_one_path_alone(bench: Bench) -> None:
    await enabled(bench)
    first = await send(bench, json.dumps(body()), **JSON, **{"Idempotency-Key": "k"})
    again = await send(bench, json.dumps(body()), **JSON, **{"Idempotency-Key": "k"})
    assert again.headers["Idempotent-Replayed"] == "true"
    assert again.json()["id"] == first.json()["id"]
    told = await refused(
        bench, json.dumps(body(cycle_ms=20)), "key_reused", **JSON, **{"Idempotency-Key": "k"}
    )
    assert told["status"] == 422
    cancelled = await bench.post(f"/operations/{first.json()['id']}/cancel")
    assert cancelled.json()["state"] in ("cancelled", "succeeded")


async def many_points(kind: str, count: int) -> AsyncIterator[bytes]:
    """A slow wave, a point each 10 ms, in pieces."""
    yield (
        b"t,stage.x[steps]\n" if kind == "csv" else b'{"axes":[{"node":1,"axis":0,"unit":"steps"}],"points":['
    )
    for first in range(0, count, 1000):
        piece = ""
        for number in range(first, first + 1000):
            place = 10_000 * (1 - math.cos(2 * math.pi * number / count))
            if kind == "csv":
                piece += f"{number / 100:.2f},{place:.6f}\n"
            else:
                piece += f'{{"t":{number / 100:.2f},"positions":[{place:.6f}]}},'
        if kind == "json" and first + 1000 == count:
            piece = piece[:-1] + "]}"
        yield piece.encode()


async def test_many_points_take_no_memory(bench: Bench) -> None:
    for kind, headers in (("csv", CSV), ("json", JSON)):
        tracemalloc.start()
        try:
            response = await send(bench, many_points(kind, 10_000), "?dry_run=true", **headers)
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert response.json()["points"] == 10_000, response.text
        assert peak < 2_500_000, kind  # one block of points, whatever their number; all would be 5 MB


async def test_a_hundred_thousand_points_are_looked_at(bench: Bench) -> None:
    response = await send(bench, many_points("csv", 100_000), "?dry_run=true", **CSV)
    assert response.json()["points"] == 100_000, response.text
    assert response.json()["duration_s"] == 999.99


async def test_a_body_beyond_the_limit_is_cut_off(bench: Bench) -> None:
    del bench  # another service, with less room
    from api_bench import running

    configuration = Configuration.model_validate({"trajectories": {"max_bytes": 2000}})
    async with running(configuration) as small:
        told = await refused(small, b" " * 2001, "body_too_large")
        assert "2000" in told["detail"]

        async def pieces() -> AsyncIterator[bytes]:
            for _ in range(3):
                yield b" " * 1000

        await refused(small, pieces(), "body_too_large")


async def test_a_full_disk_refuses_the_path_and_nothing_moves(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its last points go to the disk only when they are looked at."""
    await enabled(bench)

    def full(_: PointFile) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(PointFile, "_flush", full)
    told = await refused(bench, json.dumps(body()), "no_room")
    assert (told["status"], "No space left" in told["detail"]) == (503, True)
    monkeypatch.undo()
    assert (await bench.get("/operations")).json()["operations"] == []
    assert (await bench.post("/trajectories?wait=20", body())).json()["state"] == "succeeded"


async def test_a_path_is_not_followed_by_limits_that_it_was_not_held_against(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A large path takes seconds to be looked at; somebody narrows the limits meanwhile."""
    await enabled(bench)
    axis = bench.service.network.node(1).axis(0)
    look = routes.survey

    async def narrow() -> None:
        url = "/api/v1/nodes/1/axes/0/settings"
        headers = {"If-Match": (await bench.client.get(url)).headers["ETag"], **JSON}
        body = {"soft_limits": ["-10 steps", "10 steps"]}
        response = await bench.client.patch(url, json=body, headers=headers)
        assert response.status_code == 200, response.text

    def slowly(*given: Any) -> Any:
        found = look(*given)
        asyncio.run_coroutine_threadsafe(narrow(), loop).result(20)
        return found

    loop = asyncio.get_running_loop()
    monkeypatch.setattr(routes, "survey", slowly)
    told = await refused(bench, json.dumps(body()), "not_ready")
    assert [each["code"] for each in told["obstacles"]] == ["settings_changed"]
    assert (await bench.get("/operations")).json()["operations"] == []
    assert not axis.status.moving
