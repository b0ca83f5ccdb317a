"""Storms, a controller in trouble, adapters pulled, full queues, broken process data."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from api_bench import Bench, EventClient
from fault_kit import (
    EMERGENCY,
    SDO_ANSWER,
    ended,
    metric,
    moving,
    node_is,
    reasons,
    refusal,
    sent_to,
    truly_moving,
    truly_state,
)

from drivers.bus.base import BusState
from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia402.power import PowerState
from drivers.errors import BusOverflow

pytestmark = pytest.mark.looptime

STORM = 3000


async def test_an_emergency_storm_is_bounded_and_a_stop_is_served(bench: Bench) -> None:
    await moving(bench)
    for number in range(STORM):
        bench.wire.inject(Frame(EMERGENCY, bytes([0x01, 0xFF, 0x81, number % 256, 1, 0, 0, number // 256])))
    assert (await bench.post("/nodes/1/axes/0/stop")).json()["moving"] is False
    assert not truly_moving(bench)
    listed = (await bench.get("/nodes/1/emergencies")).json()["emergencies"]
    assert 0 < len(listed) <= 256
    assert await metric(bench, 'canaxis_node_emergencies_total{node="1"}') >= STORM
    assert (await bench.client.get("/livez")).status_code == 200


async def test_a_flood_of_identifiers_is_counted_and_a_stop_is_served(bench: Bench) -> None:
    await moving(bench)
    for number in range(STORM):
        bench.wire.inject(Frame(number % 0x7E0 | 0x1000, bytes(8), extended=True), Frame(0x7F0, bytes(8)))
    assert (await bench.client.post("/api/v1/stop")).json()["complete"] is True
    assert not truly_moving(bench)
    counters = (await bench.get("/bus")).json()["counters"]
    assert counters["extended_frames"] >= STORM
    assert counters["unrouted"] >= STORM


async def test_error_passive_is_told_and_does_not_stop_work(bench: Bench) -> None:
    await bench.enable()
    async with EventClient(bench.app) as events:
        await events.next("snapshot")
        bench.master_port.degrade(BusState.PASSIVE)
        assert (await events.next("bus")).data["state"] == "passive"
    bus = (await bench.get("/bus")).json()
    assert bus["state"] == "passive"
    assert bus["reason"]
    assert (await bench.move(500, wait=30)).json()["state"] == "succeeded"
    bench.master_port.degrade(BusState.ACTIVE)
    assert (await bench.get("/bus")).json()["state"] == "active"


@pytest.mark.parametrize("trouble", ["bus_off", "unplug"])
async def test_a_bus_that_can_t_carry_commands_says_so_and_never_stopped(bench: Bench, trouble: str) -> None:
    operation = await moving(bench)
    async with EventClient(bench.app) as events:
        await events.next("snapshot")
        getattr(bench.master_port, trouble)()
        told = await events.next("bus")
        assert told.data["state"] == {"bus_off": "bus_off", "unplug": "down"}[trouble]
    failed = await ended(bench, operation)
    assert failed["state"] == "failed"
    assert failed["error"]["status"] == 503
    for command, body in (("move", {"target": 1, "unit": "steps"}), ("enable", None), ("stop", None)):
        refused = await bench.post(f"/nodes/1/axes/0/{command}", body)
        assert refused.status_code == 503, command
    assert "unknown" in (await bench.post("/nodes/1/axes/0/stop")).json()["detail"]
    report = (await bench.client.post("/api/v1/stop")).json()
    assert (report["complete"], {axis["outcome"] for axis in report["axes"]}) == (False, {"unreachable"})
    assert (await reasons(bench))[0].startswith("The bus is")
    assert (await bench.axis())["stale"] is True
    assert await metric(bench, "canaxis_bus_up") == 0
    await asyncio.sleep(2)
    assert not truly_moving(bench), "meanwhile the module has stopped itself"
    assert truly_state(bench) == PowerState.FAULT.value


@pytest.mark.parametrize(("trouble", "cure"), [("bus_off", "recover"), ("unplug", "plug")])
async def test_a_bus_that_comes_back_is_taken_up_again_without_a_restart(
    bench: Bench, trouble: str, cure: str
) -> None:
    await moving(bench)
    getattr(bench.master_port, trouble)()
    await node_is(bench, "lost")
    await asyncio.sleep(5)
    getattr(bench.master_port, cure)()
    await bench.until_ready()
    assert await reasons(bench) == []
    assert (await bench.get("/bus")).json()["reason"] == ""
    assert (await bench.axis())["state"] == "fault", "nothing is reset by itself"
    assert refusal(await bench.move(1))[0] == 409
    assert (await bench.post("/nodes/1/axes/0/reset-fault")).status_code == 200
    await bench.enable()
    assert (await bench.move(100, relative=True, wait=30)).json()["state"] == "succeeded"


async def test_a_stop_has_a_way_of_its_own_past_a_full_transmit_queue(bench: Bench) -> None:
    await moving(bench)
    bench.master_port.hold()
    with contextlib.suppress(BusOverflow):
        while True:
            bench.master_port.send(Frame(0x7E5, bytes(8)))
    halt = bench.service.network.node(1).axis(0).pdos.power.cob_id
    sent = sent_to(bench, halt, 0x7E5)
    stop = asyncio.create_task(bench.post("/nodes/1/axes/0/stop"))
    await asyncio.sleep(0.01)
    bench.master_port.release()
    assert (await stop).json()["moving"] is False
    assert len(sent) > 200
    assert sent[0].cob_id == halt
    assert not truly_moving(bench)


async def test_a_full_transmit_queue_is_told_to_who_commands(bench: Bench) -> None:
    await bench.enable()
    bench.master_port.hold()
    for _ in range(2):  # what was on the wire already leaves room for one more
        with contextlib.suppress(BusOverflow):
            while True:
                bench.master_port.send(Frame(0x7E5, bytes(8)))
        await asyncio.sleep(0.01)
    response = await bench.move(1000, wait=30)
    problem = response.json() if response.status_code >= 400 else response.json()["error"]
    assert (problem["status"], problem["code"]) == (503, "bus_overflow")
    assert problem["hint"]
    bench.master_port.release()
    await asyncio.sleep(5)
    assert not truly_moving(bench), "what was refused is not sent later"


@pytest.mark.parametrize("length", [0, 3, 8])
async def test_process_data_of_a_wrong_length_is_dropped_counted_and_ages(bench: Bench, length: int) -> None:
    await bench.enable()
    axis = bench.service.network.node(1).axis(0)
    before = await bench.axis()
    bench.wire.faults.corrupt(
        lambda frame: frame._replace(data=(frame.data + bytes(8))[:length]),
        cob_id(axis.pdos.status.cob_id),
    )
    await bench.until(lambda: axis.status.stale)
    now = await bench.axis()
    assert now["stale"] is True
    assert (now["state"], now["statusword"], now["position"]) == (
        before["state"], before["statusword"], before["position"],
    )  # fmt: skip
    assert await metric(bench, 'canaxis_node_short_pdos_total{node="1"}') > 0
    assert refusal(await bench.move(1)) == (409, "not_ready")


async def test_lost_and_doubled_frames_cost_a_move_at_most(bench: Bench) -> None:
    """What is repeated is idempotent; a set point never is."""
    await bench.enable()
    axis = bench.service.network.node(1).axis(0)
    bench.wire.faults.duplicate(lambda frame: frame.cob_id != SDO_ANSWER)
    assert (await bench.move(1000, relative=True, wait=30)).json()["state"] == "succeeded"
    assert (await bench.axis())["position"]["steps"] == 1000
    bench.wire.faults.clear()
    bench.wire.faults.drop(
        lambda frame: frame.cob_id == axis.pdos.position.cob_id and bool(frame.data[0] & 0x10), count=1
    )
    failed = (await bench.move(1000, relative=True, wait=30)).json()
    assert failed["state"] == "failed"
    await asyncio.sleep(5)
    assert (await bench.axis())["position"]["steps"] == 1000, "it was not sent again"
