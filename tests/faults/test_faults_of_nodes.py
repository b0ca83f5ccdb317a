"""Nodes that are absent, late, reset, silent, doubled, or in trouble with their own CAN."""

from __future__ import annotations

import asyncio
import itertools

import pytest
from api_bench import Bench, EventClient, running
from fault_kit import (
    FAR,
    HEARTBEAT,
    SDO_ANSWER,
    Written,
    ended,
    metric,
    moving,
    node_is,
    reasons,
    refusal,
    truly_moving,
    truly_state,
)

from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.master.seen.status import NodeState

pytestmark = pytest.mark.looptime


async def test_absent_at_start_the_service_runs_and_probes_more_and_more_rarely() -> None:
    async with running(powered=False) as bench:
        assert (await bench.get("/nodes/1")).json()["state"] == "absent"
        assert "absent" in (await reasons(bench))[0]
        assert refusal(await bench.move(1)) == (503, "node_away")
        assert refusal(await bench.post("/nodes/1/axes/0/enable")) == (503, "node_away")
        probes: list[float] = []
        loop = asyncio.get_running_loop()
        bench.wire.tap(lambda _, frame: probes.append(loop.time()) if frame.data[:1] == b"\x40" else None)
        await asyncio.sleep(60)
        gaps = [later - earlier for earlier, later in itertools.pairwise(probes)]
        assert 5 < len(probes) < 40
        assert max(gaps) > 4, "with back-off"
        assert max(gaps) < 10, "and a bound"


async def test_appearing_late_it_is_taken_in_and_not_enabled() -> None:
    async with running(powered=False) as bench:
        await asyncio.sleep(20)
        async with bench.module:
            await bench.until_ready()
            node = (await bench.get("/nodes/1")).json()
            assert (node["state"], node["failsafe"], node["nmt_state"]) == (
                "operational", "unverified", "operational",
            )  # fmt: skip
            assert await reasons(bench) == []
            await asyncio.sleep(5)
            assert [truly_state(bench, axis) for axis in range(3)] == [
                PowerState.SWITCH_ON_DISABLED.value
            ] * 3
            await bench.enable()
            assert (await bench.move(100, wait=30)).json()["state"] == "succeeded"


async def test_reset_in_mid_move_the_move_fails_and_all_is_armed_anew(bench: Bench) -> None:
    await bench.enable()
    assert (await bench.post("/nodes/1/axes/0/home?wait=60", {"method": 35})).json()["state"] == "succeeded"
    operation = await moving(bench)
    written = Written(bench)
    async with EventClient(bench.app) as events:
        await events.next("snapshot")
        bench.module.power_cycle()
        told = await events.next("motion")
        assert (told.data["id"], told.data["state"]) == (operation["id"], "failed")
    failed = await ended(bench, operation)
    assert (failed["state"], failed["error"]["code"], failed["error"]["status"]) == (
        "failed",
        "node_away",
        503,
    )
    assert "restarted" in failed["error"]["detail"]
    await bench.until_ready()
    status = await bench.axis()
    assert (status["referenced"], status["moving"], status["state"]) == (False, False, "switch_on_disabled")
    assert {0x1016, 0x1029, 0x1017} <= {address.index for address in written.addresses}, "armed anew"
    assert refusal(await bench.move(1)) == (409, "not_ready")
    await asyncio.sleep(5)
    assert truly_state(bench) == PowerState.SWITCH_ON_DISABLED.value, "never enabled or homed by itself"
    await bench.enable()
    assert (await bench.move(100, wait=30)).json()["state"] == "succeeded"


async def test_a_late_heartbeat_refuses_motion_and_sends_a_stop(bench: Bench) -> None:
    operation = await moving(bench)
    bench.wire.faults.drop(cob_id(HEARTBEAT))
    failed = await ended(bench, operation)
    assert failed["state"] == "failed"
    assert "heartbeat" in failed["error"]["detail"]
    assert "unknown" in failed["error"]["detail"], "a stop was sent, not seen"
    assert (await bench.get("/nodes/1")).json()["state"] == "operational", "late, and not yet lost"
    assert refusal(await bench.move(1)) in ((409, "not_ready"), (503, "node_away"))
    obstacles = (await bench.get("/nodes/1/axes/0/readiness")).json()["move"]
    assert "heartbeat_stale" in [obstacle["code"] for obstacle in obstacles]
    await node_is(bench, "lost")
    assert not truly_moving(bench), "the stop got through"
    assert "lost" in (await reasons(bench))[0]


async def test_a_heartbeat_that_comes_back_clears_nothing_by_itself(bench: Bench) -> None:
    await moving(bench)
    silence = bench.wire.faults.drop(cob_id(HEARTBEAT))
    await node_is(bench, "lost")
    silence.end()
    await bench.until_ready()
    assert (await bench.axis())["state"] == "operation_enabled", "as it was found"
    assert refusal(await bench.move(1)) == (409, "not_ready")
    await asyncio.sleep(5)
    assert not truly_moving(bench)
    await bench.enable()
    assert (await bench.move(100, relative=True, wait=30)).json()["state"] == "succeeded"


async def test_two_nodes_with_one_id_are_blocked_and_not_written_to() -> None:
    async with running(powered=False) as bench:
        bench.wire.faults.duplicate(cob_id(SDO_ANSWER))
        written = Written(bench)
        async with bench.module:
            node = await node_is(bench, "duplicate")
            assert "two nodes" in node["reason"]
            assert "duplicate" in (await reasons(bench))[0]
            assert refusal(await bench.move(1)) == (503, "node_away")
            assert refusal(await bench.post("/nodes/1/axes/0/enable")) == (503, "node_away")
            assert written.addresses == []
            assert await metric(bench, 'canaxis_node_state{node="1",state="duplicate"}') == 1
            await bench.service.close()


async def test_a_boot_up_out_of_the_blue_is_a_second_node(bench: Bench) -> None:
    """A second module with the same ID is switched on while ours goes on: what moves is stopped."""
    node = bench.service.network.node(1)
    operation = await moving(bench)
    bench.wire.inject(Frame(HEARTBEAT, b"\x00"))
    failed = await ended(bench, operation)
    assert (failed["state"], failed["error"]["code"]) == ("failed", "node_away")
    await bench.until(lambda: node.state is NodeState.DUPLICATE)
    assert refusal(await bench.move(1)) == (503, "node_away")
    await bench.until(lambda: not truly_moving(bench))
    await bench.until(lambda: node.state is NodeState.OPERATIONAL, within=60)  # alone again
    await bench.until_ready()
    status = await bench.axis()
    assert (status["reference"], status["adopted"]) == ("lost", True)
    assert refusal(await bench.move(1)) == (409, "not_ready")
    stop = await bench.post("/nodes/1/axes/0/stop")
    assert stop.status_code == 200
    assert not truly_moving(bench)


@pytest.mark.parametrize("code", [0x8110, 0x8140], ids=["overrun", "bus_off"])
async def test_a_can_trouble_of_the_module_s_makes_the_last_command_unconfirmed(
    bench: Bench, code: int
) -> None:
    operation = await moving(bench)
    await asyncio.sleep(1)  # until the set point is handed over, and not sent once more
    await bench.service.network.node(1).write(Address(0x607A), 7)  # the module holds another target than ours
    bench.module.report(code)
    failed = await ended(bench, operation)
    assert (failed["state"], failed["error"]["code"]) == ("failed", "motion_failed")
    assert "unconfirmed" in failed["error"]["detail"]
    axis = bench.service.network.node(1).axis(0)
    await bench.until(lambda: axis.errand is None and not axis.status.moving)
    assert not truly_moving(bench)
    listed = (await bench.get("/nodes/1/emergencies")).json()["emergencies"]
    assert f"0x{code:04X}" in [each["code"] for each in listed]


async def test_another_module_under_the_id_is_refused_and_not_written_to() -> None:
    async with running(powered=False) as bench:
        bench.wire.faults.corrupt(
            lambda frame: frame._replace(data=frame.data[:4] + (3214).to_bytes(4, "little")),
            lambda frame: frame.cob_id == SDO_ANSWER and frame.data[:4] == bytes.fromhex("43181002"),
        )
        written = Written(bench)
        async with bench.module:
            node = await node_is(bench, "refused")
            assert "TMCM-3216" in node["reason"]
            assert written.addresses == []
            assert refusal(await bench.move(FAR)) == (503, "node_away")
            await bench.service.close()


async def test_a_node_that_restarts_and_starts_itself_is_no_second_node(bench: Bench) -> None:
    """Some modules enter NMT Operational by themselves after a boot-up; nothing of theirs is energised."""
    node = bench.service.network.node(1)
    states: list[NodeState] = []
    bench.wire.inject(Frame(HEARTBEAT, b"\x00"))  # and then its heartbeats say Operational, as before
    await bench.until(lambda: states.append(node.state) or node.state is NodeState.BOOTED)
    await bench.until(lambda: states.append(node.state) or node.state is NodeState.OPERATIONAL)
    assert NodeState.DUPLICATE not in states
    assert NodeState.REFUSED not in states
