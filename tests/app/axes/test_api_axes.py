"""Axes over HTTP: status, readiness, and from one state of the drive to another."""

from __future__ import annotations

import pytest
from api_bench import Bench

pytestmark = pytest.mark.looptime


async def test_the_status_names_every_unit_and_its_age(bench: Bench) -> None:
    status = await bench.axis()
    assert status["state"] == "switch_on_disabled"
    assert status["position"] == {"steps": 0, "value": 0.0, "unit": "steps"}
    assert status["velocity"]["unit"] == "steps/s"
    assert (status["node"], status["axis"], status["name"]) == (1, 0, "x")
    assert status["moving"] is False
    assert status["referenced"] is False
    assert status["limits"] == {"negative": False, "positive": False}
    assert status["home_switch"] is False
    assert status["emergencies"] == []
    assert 0 <= status["age_s"] < 0.5
    assert status["stale"] is False


async def test_names_and_numbers_mean_the_same(bench: Bench) -> None:
    by_number = await bench.get("/nodes/1/axes/1")
    by_name = await bench.get("/nodes/stage/axes/y")
    assert by_number.status_code == by_name.status_code == 200
    assert by_number.json()["name"] == by_name.json()["name"] == "y"


async def test_all_axes_and_all_nodes_are_listed(bench: Bench) -> None:
    assert [a["axis"] for a in (await bench.get("/nodes/1/axes")).json()["axes"]] == [0, 1, 2]
    [node] = (await bench.get("/nodes")).json()["nodes"]
    assert node["state"] == "operational"
    assert node["device_name"] == "TMCM-3216"
    assert node["identity"]["vendor_id"] == "0x00000286"
    assert [a["path"] for a in node["axes"]] == [f"/api/v1/nodes/1/axes/{n}" for n in range(3)]
    assert (await bench.get("/nodes/stage")).json()["node"] == 1


async def test_enable_and_disable_answer_when_it_is_done(bench: Bench) -> None:
    response = await bench.post("/nodes/1/axes/0/enable")
    assert response.status_code == 200
    assert response.json()["state"] == "operation_enabled"
    assert (await bench.axis("1"))["state"] == "switch_on_disabled", "the others stay as they are"
    response = await bench.post("/nodes/1/axes/0/disable")
    assert response.status_code == 200
    assert response.json()["state"] == "switch_on_disabled"


async def test_readiness_names_each_obstacle_with_its_remedy(bench: Bench) -> None:
    before = (await bench.get("/nodes/1/axes/0/readiness")).json()
    assert before["ready"] is False
    assert [o["code"] for o in before["move"]] == ["not_enabled"]
    assert before["move"][0]["remedy"]
    assert before["enable"] == []
    await bench.enable()
    after = (await bench.get("/nodes/1/axes/0/readiness")).json()
    assert after["ready"] is True
    assert after["move"] == after["velocity"] == after["home"] == []


async def test_a_disabled_axis_says_what_to_do(bench: Bench) -> None:
    response = await bench.move(1000)
    assert response.status_code == 409
    problem = response.json()
    assert response.headers["content-type"] == "application/problem+json"
    assert problem["code"] == "not_ready"
    assert problem["type"] == "/problems/not-ready"
    assert problem["instance"] == "/api/v1/nodes/1/axes/0/move"
    assert [o["code"] for o in problem["obstacles"]] == ["not_enabled"]
    assert "nable" in problem["hint"]
    assert (problem["node"], problem["axis"]) == (1, 0)


UNKNOWN = [
    ("/nodes/9", "unknown_node"),
    ("/nodes/nobody/axes", "unknown_node"),
    ("/nodes/1/axes/3", "unknown_axis"),
    ("/nodes/1/axes/w/readiness", "unknown_axis"),
    ("/nodes/1/axes/99999999999999999999999999", "unknown_axis"),
    ("/operations/nothing", "unknown_operation"),
    ("/nothing", "unknown_path"),
]


async def test_what_is_unknown_is_404_with_a_hint(bench: Bench) -> None:
    for path, code in UNKNOWN:
        response = await bench.get(path)
        assert response.status_code == 404
        assert response.json()["code"] == code
        assert response.json()["hint"]


async def test_an_unknown_axis_is_404_for_every_command(bench: Bench) -> None:
    for command in ("enable", "disable", "stop", "quick-stop", "reset-fault"):
        assert (await bench.post(f"/nodes/1/axes/7/{command}")).json()["code"] == "unknown_axis"
        assert (await bench.post(f"/nodes/7/axes/0/{command}")).json()["code"] == "unknown_node"


async def test_a_wrong_method_is_a_problem_too(bench: Bench) -> None:
    response = await bench.get("/nodes/1/axes/0/enable")
    assert response.status_code == 405
    assert response.headers["content-type"] == "application/problem+json"
    assert response.headers["allow"] == "POST"


async def test_stop_brings_a_moving_axis_to_rest_and_keeps_it_enabled(bench: Bench) -> None:
    await bench.enable()
    moving = (await bench.move(10_000_000)).json()
    await bench.until_moving()
    response = await bench.client.post("/api/v1/nodes/1/axes/0/stop")
    assert response.status_code == 200
    assert response.json()["state"] == "operation_enabled"
    assert response.json()["moving"] is False
    operation = (await bench.get(f"/operations/{moving['id']}")).json()
    assert operation["state"] == "cancelled"
    assert "stopped" in operation["reason"]


async def test_quick_stop_ends_switched_off(bench: Bench) -> None:
    await bench.enable()
    await bench.move(10_000_000)
    await bench.until_moving()
    response = await bench.client.post("/api/v1/nodes/1/axes/0/quick-stop")
    assert response.status_code == 200
    assert response.json()["state"] == "switch_on_disabled"


async def test_a_fault_is_explained_and_reset(bench: Bench) -> None:
    await bench.enable()
    await bench.move(10_000_000)
    await bench.until_moving()
    axis = bench.service.network.node(1).axis(0)
    bench.module.apply(lambda module, at: module.axes[0].supply(5.0, at))
    await bench.until(lambda: axis.status.state == "fault" and bool(axis.status.emergencies))
    status = await bench.axis()
    assert status["emergencies"][0]["cause"]
    assert status["emergencies"][0]["remedy"]
    refused = await bench.post("/nodes/1/axes/0/enable")
    assert refused.status_code == 409
    assert "fault" in [o["code"] for o in refused.json()["obstacles"]]
    bench.module.apply(lambda module, at: module.axes[0].supply(24.0, at))
    await bench.until(lambda: axis.errand is None)
    response = await bench.post("/nodes/1/axes/0/reset-fault")
    assert response.status_code == 200, response.text
    assert response.json()["state"] == "switch_on_disabled"
    await bench.enable()
    listed = (await bench.get("/nodes/1/emergencies")).json()["emergencies"]
    assert listed
    assert listed[0]["id"] == max(e["id"] for e in listed), "the newest first"
    assert {"code", "register", "data", "title", "cause", "remedy", "active"} <= set(listed[0])
