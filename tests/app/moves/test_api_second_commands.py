"""A second command for an axis, velocities with an end, dry runs, and remedies that can be called."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import httpx
import pytest
from api_bench import Bench, running

from app.configuration.configuration import Configuration
from drivers.master.axis.waiting_line import LONGEST

pytestmark = pytest.mark.looptime
AXIS = "/nodes/1/axes/0"


async def state(bench: Bench, reply: httpx.Response, wait: float = 60) -> dict[str, Any]:
    """The operation of a reply, at its end."""
    return (await bench.get(f"/operations/{reply.json()['id']}?wait={wait}")).json()


async def test_reject_queue_and_replace_are_the_caller_s_choice(bench: Bench) -> None:
    await bench.enable()
    first = await bench.move(60_000)
    rejected = await bench.move(5)
    assert (rejected.status_code, rejected.json()["code"]) == (409, "axis_busy")
    assert rejected.json()["operation"] == first.json()["links"]["self"]
    second = await bench.move(100, relative=True, on_busy="queue")
    third = await bench.move(-7, relative=True, on_busy="queue")
    assert [reply.status_code for reply in (second, third)] == [202, 202]
    assert second.json()["state"] == "queued"
    assert (await bench.axis())["queued"] == [second.json()["id"], third.json()["id"]]
    stored = (await bench.get("/operations?state=queued")).json()["operations"]
    assert {second.json()["id"], third.json()["id"]} <= {one["id"] for one in stored}
    assert (await state(bench, third))["result"]["position"]["steps"] == 60_093
    await bench.move(0)
    waiting = await bench.move(9, on_busy="queue")
    replacing = await bench.move(1234, on_busy="replace", wait=60)
    assert replacing.json()["result"]["position"]["steps"] == 1234
    ended = await state(bench, waiting)
    assert ended["state"] == "cancelled"
    assert "Another command replaced it" in ended["reason"]
    assert ended["started"] is None


async def test_a_waiting_operation_is_cancelled_by_itself(bench: Bench) -> None:
    await bench.enable()
    first = await bench.move(60_000)
    second = await bench.move(5, on_busy="queue")
    await bench.until_moving()
    cancelled = await bench.post(f"/operations/{second.json()['id']}/cancel")
    assert cancelled.json()["state"] == "cancelled"
    assert (await bench.axis())["moving"]
    assert (await state(bench, first))["state"] == "succeeded"


async def test_a_full_queue_is_503_with_a_time_to_wait_and_frees_its_key(bench: Bench) -> None:
    await bench.enable()
    await bench.move(400_000)
    for _ in range(LONGEST):
        assert (await bench.move(1, on_busy="queue")).status_code == 202
    for _ in range(2):
        body = {"target": 1, "unit": "steps", "on_busy": "queue"}
        full = await bench.post(f"{AXIS}/move", body, headers={"Idempotency-Key": "full"})
        assert (full.status_code, full.json()["code"]) == (503, "axis_queue_full")
        assert 1 <= int(full.headers["Retry-After"]) <= 10
    await bench.post(f"{AXIS}/stop")
    assert (await bench.axis())["queued"] == []


async def test_a_velocity_may_have_an_end(bench: Bench) -> None:
    await bench.enable()
    body = {"velocity": 40_000, "unit": "steps", "duration_s": 1.5}
    turning = await bench.post(f"{AXIS}/velocity", body)
    assert turning.json()["predicted_s"] == pytest.approx(1.5 + 2 * 0.39, rel=0.02)
    assert turning.json()["predicted_peak_velocity"] == {"steps": 40000, "value": 40000.0, "unit": "steps/s"}
    axis = bench.service.network.node(1).axis(0)
    await bench.until(lambda: axis.motion is not None and (axis.motion.progress or 0) > 0.5)
    assert 0.5 < (await state(bench, turning, 0.01))["progress"] < 1
    done = await state(bench, turning)
    assert (done["state"], done["result"]["turning"]) == ("succeeded", False)
    assert not (await bench.axis())["moving"]
    before = axis.status.position or 0
    body = {"velocity": -40_000, "unit": "steps", "travel": 30_001}
    done = (await bench.post(f"{AXIS}/velocity?wait=60", body)).json()
    assert done["result"]["position"]["steps"] == before - 30_001
    assert done["request"]["travel_steps"] == 30_001


BAD_ENDS = [
    {"duration_s": 1, "travel": 5},
    {"duration_s": 0},
    {"duration_s": 1e9},
    {"travel": 0},
    {"travel": -1},
    {"travel": 2**31},
    {"lease": True},
    {"velocity": 0, "duration_s": 1},
    {"on_busy": "wait"},
    {"on_busy": None},
]


async def test_ends_that_can_t_be_are_422_and_nothing_is_sent(bench: Bench) -> None:
    await bench.enable()
    sent = bench.service.network.counters.sent
    for bad in BAD_ENDS:
        reply = await bench.post(f"{AXIS}/velocity", {"velocity": 100, "unit": "steps", **bad})
        assert reply.status_code == 422, (bad, reply.text)
    assert bench.service.network.node(1).axis(0).errand is None
    assert bench.service.network.counters.sent - sent < 20  # heartbeats


# --- looking before moving


async def test_a_dry_run_tells_all_and_does_nothing(bench: Bench) -> None:
    body = {"target": 51_200, "unit": "steps", "velocity": 20_000}
    sent: list[int] = []
    bench.wire.tap(lambda port, frame: sent.append(frame.cob_id) if port == "master" else None)
    key = {"Idempotency-Key": "look"}
    looked = await bench.post(f"{AXIS}/move?dry_run=true", body, headers=key)
    assert looked.status_code == 200
    seen = looked.json()
    assert (seen["accepted"], seen["begins"]) == (False, None)
    assert [one["code"] for one in seen["obstacles"]] == ["not_enabled"]
    assert seen["predicted_s"] == pytest.approx(51_200 / 20_000 + 20_000 / 102_400, rel=0.01)
    assert seen["predicted_peak_velocity"]["steps"] == 20_000
    assert (seen["start"]["steps"], seen["end"]["steps"]) == (0, 51_200)
    assert seen["path"]["within"] is True
    assert [(w["index"], w["new"]) for w in seen["writes"]] == [
        ("0x6081", 20_000),
        ("0x6083", 102_400),
        ("0x6084", 102_400),
    ]
    assert seen["request"]["target_steps"] == 51_200
    assert (await bench.get("/operations")).json()["operations"] == []
    assert not {cob for cob in sent if cob in (0x201, 0x301, 0x401, 0x601)}
    await bench.enable()
    done = (await bench.post(f"{AXIS}/move?wait=60", body, headers=key)).json()
    assert done["state"] == "succeeded", "the key was not spent"
    assert done["predicted_s"] == seen["predicted_s"]
    again = (await bench.post(f"{AXIS}/move?dry_run=true", body)).json()
    assert (again["accepted"], again["begins"], again["predicted_s"]) == (True, "at_once", 0.0)
    assert again["writes"] == []


async def test_a_dry_run_of_each_kind_and_each_choice(bench: Bench) -> None:
    looked = (await bench.post(f"{AXIS}/home?dry_run=true", {"method": 19})).json()
    assert looked["predicted_s"] == pytest.approx(420, rel=0.05)
    assert (looked["end"], looked["path"]) == (None, None)
    assert any("no software limits" in sentence for sentence in looked["assumed"])
    body = {"velocity": 30_000, "unit": "steps", "duration_s": 2}
    looked = (await bench.post(f"{AXIS}/velocity?dry_run=true", body)).json()
    assert looked["end"]["steps"] == pytest.approx(60_000 + 30_000**2 / 102_400, rel=0.01)
    assert ("0x60FF", 0) in [(write["index"], write["new"]) for write in looked["writes"]]
    await bench.enable()
    running = await bench.move(50_000)
    body = {"target": 10, "unit": "steps", "relative": True}
    begins = {}
    for choice in ("reject", "replace", "queue"):
        looked = (await bench.post(f"{AXIS}/move?dry_run=true", {**body, "on_busy": choice})).json()
        begins[choice] = looked["begins"]
    assert begins == {"reject": None, "replace": "replace", "queue": "queue"}
    assert looked["start"]["steps"] == 50_000
    assert (await state(bench, running))["state"] == "succeeded", "nothing touched it"


@asynccontextmanager
async def between(low: int, high: int) -> AsyncIterator[Bench]:
    """A service whose axis 0 stands, enabled, at 0, and may be sent to `low`..`high` steps."""
    axes = [{"name": "x", "soft_limits": [low, high]}, {"name": "y"}]
    configuration = Configuration.model_validate({"nodes": [{"id": 1, "name": "stage", "axes": axes}]})
    async with running(configuration) as bench:
        await bench.until_ready()
        await bench.enable("0", "1")
        yield bench


async def look(bench: Bench, verb: str, body: dict[str, Any]) -> dict[str, Any]:
    looked = await bench.post(f"{AXIS}/{verb}?dry_run=true", {"unit": "steps", **body})
    assert looked.status_code == 200, looked.text
    return looked.json()


@pytest.mark.parametrize("velocity", [20_000, -20_000])
async def test_a_dry_run_says_whether_the_whole_way_is_within_the_limits(velocity: int) -> None:
    async with between(-30_000, 30_000) as bench:
        short = await look(bench, "velocity", {"velocity": velocity, "duration_s": 1})
        assert short["path"]["within"] is True
        long = await look(bench, "velocity", {"velocity": velocity, "duration_s": 2})
        assert long["path"]["within"] is False, "one end of it is beyond"
        assert long["accepted"] is True, "the limits end it on its way"


@pytest.mark.parametrize(("low", "high"), [(1000, 9000), (-9000, -1000)])
async def test_a_dry_run_of_several_axes_says_whose_way_is_within_its_limits(low: int, high: int) -> None:
    async with between(low, high) as bench:
        middle = (low + high) // 2
        targets = [{"node": "stage", "axis": name, "target": middle, "unit": "steps"} for name in "xy"]
        said = (await bench.post("/moves?dry_run=true", {"targets": targets})).json()
        assert [axis["path"]["within"] for axis in said["axes"]] == [False, True]


@pytest.mark.parametrize(("low", "high"), [(1000, 9000), (-9000, -1000)])
async def test_an_axis_beyond_its_limits_may_move_back_and_a_dry_run_says_so(low: int, high: int) -> None:
    async with between(low, high) as bench:
        back = {"target": (low + high) // 2}
        looked = await look(bench, "move", back)
        assert (looked["accepted"], looked["obstacles"]) == (True, [])
        assert looked["path"]["within"] is False
        home = (await bench.post(f"{AXIS}/home?dry_run=true", {"method": 35})).json()
        assert home["accepted"] is True
        for beyond in ({"target": 0}, {"target": 2 * (low + high), "relative": True}):
            refused = await look(bench, "move", beyond)
            assert (refused["accepted"], refused["begins"]) == (False, None)
            assert [one["code"] for one in refused["obstacles"]] == ["beyond_limits"]
            assert (await bench.post(f"{AXIS}/move", {"unit": "steps", **beyond})).status_code == 422
        assert (await bench.move(back["target"], wait=60)).json()["state"] == "succeeded"


# --- remedies


async def follow(bench: Bench) -> list[str]:
    """Call each remedy in turn until the axis is ready; gives the paths."""
    called: list[str] = []
    for _ in range(6):
        readiness = (await bench.get(f"{AXIS}/readiness")).json()
        if readiness["ready"]:
            return called
        action = readiness["move"][0]["action"]
        assert action is not None, readiness["move"]
        assert action["method"] == "POST"
        reply = await bench.client.post(action["path"], json=action["body"])
        assert reply.status_code == 200, reply.text
        called.append(action["path"].removeprefix("/api/v1").removeprefix(AXIS))
    raise AssertionError(f"not ready after {called}")


async def test_a_fresh_axis_is_made_ready_by_its_remedies(bench: Bench) -> None:
    assert await follow(bench) == ["/enable"]
    assert (await bench.move(10, wait=60)).json()["state"] == "succeeded"


async def test_a_faulted_axis_is_made_ready_by_its_remedies(bench: Bench) -> None:
    await bench.enable()
    bench.module.apply(lambda module, now: module.axes[0].short("a", now))
    axis = bench.service.network.node(1).axis(0)
    await bench.until(lambda: [o.code for o in axis.readiness("move")] == ["fault", "not_enabled"])
    bench.module.apply(lambda module, now: module.axes[0].mend(now))
    assert await follow(bench) == ["/reset-fault", "/enable"]


async def test_a_stopped_axis_is_made_ready_by_its_remedies(bench: Bench) -> None:
    await bench.post("/stop", {"reason": "A test."})
    refused = await bench.move(5)
    assert [one["action"]["path"] for one in refused.json()["obstacles"]] == [
        "/api/v1/stop/reset",
        f"/api/v1{AXIS}/enable",
    ]
    assert await follow(bench) == ["/stop/reset", "/enable"]
    await bench.post(f"{AXIS}/velocity?wait=20", {"velocity": 9000, "unit": "steps"})
    assert await follow(bench) == ["/stop"]


async def test_several_clients_that_queue_are_served_in_order(bench: Bench) -> None:
    await bench.enable()
    replies = await asyncio.gather(
        *(bench.move(1000, relative=True, on_busy="queue", wait=60) for _ in range(6))
    )
    assert [reply.json()["state"] for reply in replies] == ["succeeded"] * 6
    assert (await bench.axis())["position"]["steps"] == 6000
