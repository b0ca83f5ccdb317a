"""Commands of a node: taking it in anew, and the check of its fail-safe."""

from __future__ import annotations

import pytest
from api_bench import Bench, running

pytestmark = pytest.mark.looptime


async def test_a_node_tells_every_step_of_its_boot_up(bench: Bench) -> None:
    boot = (await bench.get("/nodes/1")).json()["boot"]
    assert boot["complete"] is True
    assert [step["name"] for step in boot["steps"]] == [
        "identity", "axes", "heartbeats", "parameters", "pdos", "start", "status",
    ]  # fmt: skip
    assert {step["state"] for step in boot["steps"]} == {"done"}
    changes = {change["index"]: change for change in boot["steps"][2]["changes"]}
    assert changes["0x1017"] == {
        "index": "0x1017", "sub": 0, "name": changes["0x1017"]["name"], "axis": None,
        "old": 0, "new": bench.service.network.config.node_heartbeat_ms, "unit": "ms",
    }  # fmt: skip
    assert boot["took_s"] == pytest.approx(sum(step["took_s"] for step in boot["steps"]), abs=0.001)


async def test_taking_in_anew_writes_nothing_to_a_node_that_lacks_nothing(bench: Bench) -> None:
    reply = await bench.post("/nodes/1/boot")
    assert reply.status_code == 200
    assert reply.json()["state"] == "operational"
    assert {step["written"] for step in reply.json()["boot"]["steps"]} == {0}


async def test_taking_in_anew_is_refused_with_an_axis_enabled(bench: Bench) -> None:
    await bench.enable()
    reply = await bench.post("/nodes/1/boot")
    assert (reply.status_code, reply.json()["code"]) == (409, "not_ready")
    assert [obstacle["code"] for obstacle in reply.json()["obstacles"]] == ["in_use"]
    assert (await bench.axis())["state"] == "operation_enabled"


async def test_taking_in_a_node_that_is_not_there_says_so() -> None:
    async with running(powered=False) as bench:
        reply = await bench.post("/nodes/1/boot")
        assert (reply.status_code, reply.json()["code"]) == (503, "node_away")
        boot = (await bench.get("/nodes/1")).json()["boot"]
        assert boot["complete"] is False
        assert {step["state"] for step in boot["steps"]} == {"pending"}


async def test_the_check_of_the_failsafe_verifies_it_and_leaves_the_axis_in_fault(bench: Bench) -> None:
    await bench.enable()
    reply = await bench.post("/nodes/1/verify-failsafe")
    assert reply.status_code == 200, reply.text
    assert reply.json()["failsafe"] == "verified"
    assert (await bench.axis())["state"] == "fault"
    codes = {record["code"] for record in (await bench.get("/nodes/1/emergencies")).json()["emergencies"]}
    assert "0x8130" in codes
    assert (await bench.post("/nodes/1/axes/0/reset-fault")).status_code == 200
    await bench.enable()


async def test_the_check_of_the_failsafe_needs_standstill_and_an_enabled_axis(bench: Bench) -> None:
    reply = await bench.post("/nodes/1/verify-failsafe")
    assert (reply.status_code, reply.json()["obstacles"][0]["code"]) == (409, "not_enabled")
    await bench.enable()
    await bench.move(500_000)
    await bench.until_moving()
    reply = await bench.post("/nodes/1/verify-failsafe")
    assert (reply.status_code, reply.json()["obstacles"][0]["code"]) == (409, "busy")
    assert (await bench.axis())["moving"] is True


async def test_a_node_that_resets_itself_says_reference_lost(bench: Bench) -> None:
    await bench.enable()
    await bench.post("/nodes/1/axes/0/home?wait=5", {"method": 35})
    assert (await bench.axis())["reference"] == "homed"
    bench.module.power_cycle()
    node = bench.service.network.node(1)
    await bench.until(lambda: node.status().state.value != "operational")
    await bench.until_ready()
    status = await bench.axis()
    assert (status["reference"], status["referenced"], status["adopted"]) == ("lost", False, False)
    assert status["state"] == "switch_on_disabled"
