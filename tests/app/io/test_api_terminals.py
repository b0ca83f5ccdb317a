"""Inputs, outputs and waits over HTTP."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from api_bench import Bench, EventClient, running

from app.configuration.configuration import Configuration, NodeSettings
from drivers.sim.terminals import MODE as IO_MODE

pytestmark = pytest.mark.looptime


def apply(bench: Bench, terminal: int, *, on: bool) -> None:
    bench.module.apply(lambda module, _: module.terminals.apply(terminal, on))


async def wait_for(bench: Bench, body: dict[str, Any], seconds: float = 0, **kwargs: Any) -> Any:
    return await bench.post(f"/nodes/1/waits?wait={seconds}", body, **kwargs)


@pytest.fixture
async def outputs(bench: Bench) -> Bench:
    """With every pin an output."""
    bench.module.apply(lambda module, _: module.dictionary.store(IO_MODE, 0b1111))
    return bench


async def test_inputs_with_their_age(bench: Bench) -> None:
    apply(bench, 2, on=True)
    bench.module.apply(lambda module, _: module.terminals.set_analog(1, 1234))
    inputs = (await bench.get("/nodes/stage/inputs")).json()
    assert inputs["digital"] == [{"number": n, "name": f"IN{n}", "on": n == 2} for n in range(4)]
    assert inputs["analog"] == [
        {"number": 0, "name": "AIN0", "raw": 0, "volts": None},
        {"number": 1, "name": "AIN1", "raw": 1234, "volts": None},
    ]
    assert [switch["name"] for switch in inputs["switches"]][:4] == [
        *("x.negative_limit", "x.positive_limit", "x.home", "y.negative_limit"),
    ]
    assert all(not switch["stale"] and switch["age_s"] < 5 for switch in inputs["switches"])
    assert 0 <= inputs["age_s"] < 5


async def test_volts_where_the_settings_give_a_scale() -> None:
    configuration = Configuration(nodes=(NodeSettings(id=1, name="stage", analog_full_scale=10),))
    async with running(configuration) as bench:
        await bench.until_ready()
        bench.module.apply(lambda module, _: module.terminals.set_analog(0, 4095))
        inputs = (await bench.get("/nodes/1/inputs")).json()
        assert [level["volts"] for level in inputs["analog"]] == [10.0, 0.0]
        done = (await wait_for(bench, {"analog": 0, "above": 9.9, "unit": "V"}, 20)).json()
        assert done["state"] == "succeeded", done
        assert done["result"]["volts"] == 10.0


async def test_an_output_is_switched_and_read_back(outputs: Bench) -> None:
    reply = await outputs.post("/nodes/stage/outputs/1", {"on": True})
    assert (reply.status_code, reply.json()) == (
        200,
        {"node": 1, "number": 1, "name": "OUT1", "on": True, "usable": True, "push_pull": False},
    )
    assert outputs.module.module.terminals.output(1)
    assert [o["on"] for o in (await outputs.get("/nodes/1/outputs")).json()["outputs"]] == [
        *(False, True, False, False),
    ]
    assert not (await outputs.post("/nodes/1/outputs/OUT1", {"on": False})).json()["on"]


async def test_what_can_t_be_switched_is_refused_with_the_reason(bench: Bench) -> None:
    refused = await bench.post("/nodes/1/outputs/0", {"on": True})
    assert (refused.status_code, refused.json()["code"]) == (409, "not_ready")
    assert [o["code"] for o in refused.json()["obstacles"]] == ["not_an_output"]
    unknown = await bench.post("/nodes/1/outputs/9", {"on": True})
    assert (unknown.status_code, unknown.json()["code"]) == (404, "unknown_terminal")
    for body in ({}, {"on": 1}, {"on": "true"}, {"on": True, "for": 3}):
        assert (await bench.post("/nodes/1/outputs/0", body)).status_code == 422


async def test_a_wait_is_an_operation_of_the_node(bench: Bench) -> None:
    async with EventClient(bench.app) as events:
        await events.next("snapshot")
        response = await wait_for(bench, {"input": "IN0", "becomes": True, "timeout_s": 60})
        begun = response.json()
        assert (response.status_code, begun["state"], begun["kind"]) == (202, "running", "wait_input")
        assert (begun["node"], begun["axis"], begun["axes"]) == (1, None, [])
        assert begun["links"]["axis"] is None
        assert begun["request"] == {"input": "IN0", "becomes": True, "timeout_s": 60.0, "name": "IN0"}
        told = await events.next("motion")
        assert (told.data["id"], told.data["node"], told.data["axis"]) == (begun["id"], 1, None)
        apply(bench, 0, on=True)
        ended = (await bench.get(f"/operations/{begun['id']}?wait=20")).json()
        assert (ended["state"], ended["result"]["on"]) == ("succeeded", True)
        assert response.headers["location"] == f"/api/v1/operations/{begun['id']}"


async def test_a_wait_can_be_cancelled_and_fails_in_time(bench: Bench) -> None:
    begun = (await wait_for(bench, {"input": 3, "becomes": True})).json()
    cancelled = (await bench.post(f"/operations/{begun['id']}/cancel")).json()
    assert (cancelled["state"], cancelled["node"]) == ("cancelled", 1)
    late = (await wait_for(bench, {"input": 3, "becomes": True, "timeout_s": 0.05}, 20)).json()
    assert (late["state"], late["error"]["code"], late["error"]["status"]) == ("failed", "input_timeout", 504)
    assert [o["id"] for o in (await bench.get("/operations")).json()["operations"]] == [
        *(late["id"], begun["id"]),
    ]


async def test_the_same_key_waits_once(bench: Bench) -> None:
    body, key = {"input": 0, "becomes": True}, {"Idempotency-Key": "once"}
    first, second = await asyncio.gather(*(wait_for(bench, body, headers=key) for _ in range(2)))
    replies = [reply for reply in (first, second) if reply.status_code == 202]
    again = await wait_for(bench, body, headers=key)
    assert {reply.json()["id"] for reply in [*replies, again]} == {again.json()["id"]}
    assert len((await bench.get("/operations")).json()["operations"]) == 1


UNFIT = [
    {},
    {"input": 0},
    {"becomes": True},
    {"input": True, "becomes": True},
    {"input": 1.5, "becomes": True},
    {"input": 0, "becomes": True, "analog": 0},
    {"input": 0, "becomes": True, "unit": "V"},
    {"analog": 0, "above": 1},
    {"analog": 0, "unit": "raw"},
    {"analog": 0, "above": 1, "below": 2, "unit": "raw"},
    {"analog": 0, "above": 1, "unit": "mV"},
    {"input": 0, "becomes": True, "timeout_s": 0},
    {"input": "IN7", "becomes": True},
    {"analog": 2, "above": 1, "unit": "raw"},
    {"analog": 0, "above": 4095, "unit": "raw"},
    {"analog": 0, "above": 1, "unit": "V"},
]


async def test_what_can_t_be_waited_for_is_422(bench: Bench) -> None:
    for body in UNFIT:
        response = await wait_for(bench, body)
        assert response.status_code == 422, (body, response.text)
        assert response.json()["hint"]
    assert (await bench.get("/operations")).json()["operations"] == []


async def test_nothing_is_asked_of_a_node_that_is_away() -> None:
    async with running(powered=False) as bench:
        for response in (
            await bench.get("/nodes/1/inputs"),
            await bench.get("/nodes/1/outputs"),
            await bench.post("/nodes/1/outputs/0", {"on": False}),
            await wait_for(bench, {"input": 0, "becomes": True}),
        ):
            assert (response.status_code, response.json()["code"]) == (503, "node_away")
