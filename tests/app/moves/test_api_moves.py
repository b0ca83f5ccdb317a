"""Moves, speeds and homings over HTTP, and the operations behind them."""

from __future__ import annotations

import asyncio

import pytest
from api_bench import Bench, never_begun, running

from app.configuration.configuration import Configuration
from app.operations.register import KEPT

pytestmark = pytest.mark.looptime


async def test_a_move_is_accepted_with_an_operation_and_its_place(bench: Bench) -> None:
    await bench.enable()
    response = await bench.move(51200)
    assert response.status_code == 202
    operation = response.json()
    assert response.headers["location"] == f"/api/v1/operations/{operation['id']}"
    assert operation["links"]["self"] == response.headers["location"]
    assert operation["kind"] == "move"
    assert operation["state"] in ("queued", "running")
    assert operation["request"]["target_steps"] == 51200
    assert (operation["result"], operation["error"], operation["ended"]) == (None, None, None)
    assert (await bench.axis())["operation"] == operation["id"]
    done = (await bench.get(f"/operations/{operation['id']}?wait=60")).json()
    assert done["state"] == "succeeded"
    assert done["progress"] == 1.0
    assert done["started"] <= done["ended"]
    assert done["result"]["position"] == {"steps": 51200, "value": 51200.0, "unit": "steps"}
    status = await bench.axis()
    assert status["position"]["steps"] == 51200
    assert status["operation"] is None
    assert status["target_reached"] is True


async def test_waiting_answers_200_at_the_end(bench: Bench) -> None:
    await bench.enable()
    response = await bench.move(51200, wait=60)
    assert response.status_code == 200
    assert response.json()["state"] == "succeeded"
    back = await bench.move(-1200, relative=True, wait=60)
    assert back.json()["result"]["position"]["steps"] == 50000


async def test_waiting_too_short_answers_202(bench: Bench) -> None:
    await bench.enable()
    response = await bench.move(10_000_000, wait=0.5)
    assert response.status_code == 202
    assert response.json()["state"] == "running"


async def test_waiting_can_be_a_preference(bench: Bench) -> None:
    await bench.enable()
    body = {"target": 100, "unit": "steps"}
    response = await bench.post("/nodes/1/axes/0/move", body, headers={"Prefer": "respond-async, wait=30"})
    assert response.status_code == 200
    assert response.headers["preference-applied"] == "wait=30"
    ignored = await bench.post("/nodes/1/axes/0/move", body, headers={"Prefer": "wait=soon"})
    assert ignored.status_code == 202
    assert "preference-applied" not in ignored.headers


async def test_three_axes_move_at_once_each_to_its_own_target(bench: Bench) -> None:
    await bench.enable("0", "1", "2")
    targets = {"0": 20000, "1": -30000, "2": 40000}
    answers = await asyncio.gather(*(bench.move(t, axis=a, wait=60) for a, t in targets.items()))
    assert [a.json()["state"] for a in answers] == ["succeeded"] * 3
    for axis, target in targets.items():
        assert (await bench.axis(axis))["position"]["steps"] == target


async def test_a_speed_is_reached_and_ended_by_zero(bench: Bench) -> None:
    await bench.enable()
    response = await bench.post("/nodes/1/axes/0/velocity?wait=30", {"velocity": 100000, "unit": "steps"})
    assert response.status_code == 200
    assert response.json()["state"] == "succeeded"
    status = await bench.axis()
    assert status["velocity"]["steps"] == pytest.approx(100000, rel=0.02)
    assert status["moving"] is True
    response = await bench.post("/nodes/1/axes/0/velocity?wait=30", {"velocity": 0, "unit": "steps"})
    assert response.json()["state"] == "succeeded"
    assert (await bench.axis())["moving"] is False


async def test_homing_where_it_stands_references_the_axis(bench: Bench) -> None:
    await bench.enable()
    await bench.move(777, wait=60)
    response = await bench.post("/nodes/1/axes/0/home?wait=60", {"method": 35})
    assert response.status_code == 200
    assert response.json()["state"] == "succeeded", response.text
    assert response.json()["result"]["position"]["steps"] == 0
    axis = bench.service.network.node(1).axis(0)
    await bench.until(lambda: axis.status.position == 0)
    assert (await bench.axis())["referenced"] is True


async def test_units_are_the_axis_own_or_steps() -> None:
    configuration = Configuration.model_validate(
        {
            "nodes": [
                {
                    "id": 1,
                    "name": "stage",
                    "axes": [{"name": "x", "unit": "mm", "steps_per_unit": 1000, "velocity": 50}],
                }
            ]
        }
    )
    async with running(configuration) as bench:
        await bench.until_ready()
        await bench.enable("x")
        body = {"target": 12.3456, "unit": "mm", "velocity": 40.0, "acceleration": 100.0}
        done = (await bench.post("/nodes/1/axes/x/move?wait=60", body)).json()
        assert done["state"] == "succeeded"
        assert done["request"]["target_steps"] == 12346
        assert done["result"]["position"] == {"steps": 12346, "value": 12.346, "unit": "mm"}
        status = await bench.axis("x")
        assert status["position"] == {"steps": 12346, "value": 12.346, "unit": "mm"}
        assert status["velocity"]["unit"] == "mm/s"
        await bench.move(1000, axis="x", wait=60)
        assert (await bench.axis("x"))["position"]["value"] == 1.0
        refused = await bench.post("/nodes/1/axes/x/move", {"target": 1, "unit": "inch"})
        assert refused.status_code == 422
        assert "mm" in refused.json()["hint"]


GEARED = Configuration.model_validate(
    {
        "nodes": [
            {
                "id": 1,
                "name": "stage",
                "axes": [{"name": "x", "unit": "mm", "gear": "3:1", "pitch": "7 mm", "velocity": "50 mm/s"}],
            }
        ]
    }
)


async def test_a_geared_axis_is_told_in_any_of_its_units_and_relative_moves_add_no_rounding_up() -> None:
    async with running(GEARED) as bench:
        await bench.until_ready()
        await bench.enable("x")
        done = (await bench.post("/nodes/1/axes/x/move?wait=60", {"target": 0.5, "unit": "turns"})).json()
        assert done["result"]["position"] == {"steps": 76_800, "value": 3.5, "unit": "mm"}
        assert (done["request"]["target_commanded"], done["request"]["rounded_by"]) == (0.5, 0)
        await bench.move(0, axis="x", wait=60)
        for _ in range(5):
            body = {"target": 10, "unit": "µm", "relative": True}  # 219.43 steps
            done = (await bench.post("/nodes/1/axes/x/move?wait=60", body)).json()
        assert done["result"]["position"]["steps"] == round(5 * 10 * 3 * 51_200 / 7000) == 1097
        assert done["request"]["target_steps"] == 219
        assert abs(done["request"]["rounded_by"] + 0.0195) < 1e-3


async def test_relative_moves_that_wait_count_from_where_those_before_them_are_meant_to_end() -> None:
    async with running(GEARED) as bench:
        await bench.until_ready()
        await bench.enable("x")
        body = {"target": 10, "unit": "µm", "relative": True, "on_busy": "queue"}  # 219.43 steps
        path = "/nodes/1/axes/x/move"
        sent = [(await bench.post(path, body)).json()["id"] for _ in range(5)]
        ended = [(await bench.get(f"/operations/{one}?wait=60")).json() for one in sent]
        steps = [round(number * 10 * 3 * 51_200 / 7000) for number in range(1, 6)]
        assert [operation["result"]["position"]["steps"] for operation in ended] == steps
        following = (await bench.post(f"{path}?wait=60", body)).json()
        assert following["result"]["position"]["steps"] == round(6 * 10 * 3 * 51_200 / 7000)


async def test_a_relative_move_that_replaces_one_counts_from_where_that_came_to_rest() -> None:
    async with running(GEARED) as bench:
        await bench.until_ready()
        await bench.enable("x")
        body = {"target": 10, "unit": "µm", "relative": True, "on_busy": "replace"}  # 219.43 steps
        path = "/nodes/1/axes/x/move?wait=60"
        await bench.move(2_000_000, axis="x")
        await bench.until_moving()
        stood = (await bench.post(path, body)).json()["result"]["position"]["steps"] - 219
        assert 0 < stood < 2_000_000
        following = (await bench.post(path, body)).json()
        assert following["result"]["position"]["steps"] == stood + 2 * 219, "and from nothing older"


MOVE = '{"target": %s, "unit": "steps"}'


BAD_MOVES = [
    MOVE % "NaN",
    MOVE % "Infinity",
    MOVE % "-Infinity",
    MOVE % "true",
    MOVE % '"7"',
    MOVE % "1e3",
    MOVE % "1.5",
    MOVE % "null",
    MOVE % "[1]",
    MOVE % "2147483648",
    MOVE % "1e400",
    MOVE % ("9" * 5000),
    '{"target": 1}',
    '{"unit": "steps"}',
    '{"target": 1, "unit": "furlong"}',
    '{"target": 1, "unit": 7}',
    '{"target": 1, "unit": "\\ud800"}',
    '{"target": 1, "unit": "steps", "speed": 3}',
    '{"target": 1, "unit": "steps", "relative": 1}',
    '{"target": 1, "unit": "steps", "relative": "yes"}',
    '{"target": 1, "unit": "steps", "velocity": 0}',
    '{"target": 1, "unit": "steps", "velocity": -5}',
    '{"target": 1, "unit": "steps", "velocity": 99999999}',
    '{"target": 1, "unit": "steps", "acceleration": true}',
    "[]",
    "7",
    "null",
    "",
    "{",
    '{"target": 1, "unit": "steps"} x',
    "\x00",
]


async def test_bad_values_are_422_and_nothing_moves(bench: Bench) -> None:
    await bench.enable()
    for text in BAD_MOVES:
        response = await bench.client.post(
            "/api/v1/nodes/1/axes/0/move", content=text.encode(), headers={"Content-Type": "application/json"}
        )
        assert response.status_code == 422, response.text
        assert response.headers["content-type"] == "application/problem+json"
        assert response.json()["hint"]
        assert (await bench.axis())["operation"] is None


NO_JSON = [b"\xff\xfe", b'{"target": "\xff"}', b"[" * 50000]


async def test_bytes_that_are_no_json_are_422(bench: Bench) -> None:
    for content in NO_JSON:
        response = await bench.client.post(
            "/api/v1/nodes/1/axes/0/move", content=content, headers={"Content-Type": "application/json"}
        )
        assert response.status_code == 422
        assert response.json()["code"] == "bad_request"


BAD_WAITS = ["-1", "601", "nan", "inf", "true", "x", "1e9"]


async def test_a_bad_wait_is_422_and_nothing_moves(bench: Bench) -> None:
    await bench.enable()
    for wait in BAD_WAITS:
        response = await bench.post(f"/nodes/1/axes/0/move?wait={wait}", {"target": 1, "unit": "steps"})
        assert response.status_code == 422
        assert (await bench.axis())["operation"] is None


BAD_HOMINGS = [
    ({"method": 4}, "homing method"),
    ({"method": 35.0}, "method"),
    ({"method": 19, "fast": 5}, "unit"),
    ({"method": 999}, "method"),
]


async def test_bad_homings_are_422(bench: Bench) -> None:
    await bench.enable()
    for body, words in BAD_HOMINGS:
        response = await bench.post("/nodes/1/axes/0/home", body)
        assert response.status_code == 422
        assert words in response.json()["detail"]


async def test_an_operation_is_cancelled_with_a_controlled_stop(bench: Bench) -> None:
    await bench.enable()
    operation = (await bench.move(10_000_000)).json()
    await bench.until_moving()
    response = await bench.post(f"/operations/{operation['id']}/cancel")
    assert response.status_code == 200
    assert response.json()["state"] == "cancelled"
    status = await bench.axis()
    assert status["moving"] is False
    assert status["state"] == "operation_enabled"
    again = await bench.post(f"/operations/{operation['id']}/cancel")
    assert (again.status_code, again.json()["state"]) == (200, "cancelled")


async def test_operations_are_listed_the_newest_first_and_by_state(bench: Bench) -> None:
    await bench.enable()
    first = (await bench.move(100, wait=60)).json()
    second = (await bench.move(10_000_000)).json()
    listed = (await bench.get("/operations")).json()["operations"]
    assert [o["id"] for o in listed] == [second["id"], first["id"]]
    done = (await bench.get("/operations?state=succeeded")).json()["operations"]
    assert [o["id"] for o in done] == [first["id"]]
    assert len((await bench.get("/operations?limit=1")).json()["operations"]) == 1
    assert (await bench.get("/operations?limit=0")).status_code == 422


async def test_two_clients_on_one_axis_the_second_learns_who_was_first(bench: Bench) -> None:
    await bench.enable()
    first, second = await asyncio.gather(bench.move(10_000_000), bench.move(5))
    assert first.status_code == 202
    assert second.status_code == 409
    problem = second.json()
    assert problem["code"] == "axis_busy"
    assert problem["operation"] == first.headers["location"]
    assert "stop" in problem["hint"].lower()
    await bench.until_moving()
    assert (await bench.get(f"/operations/{first.json()['id']}")).json()["state"] == "running"


async def test_a_stop_in_mid_homing_cancels_it(bench: Bench) -> None:
    await bench.enable()
    body = {"method": 19, "fast": 5000, "slow": 1000, "acceleration": 100000, "unit": "steps"}
    homing = (await bench.post("/nodes/1/axes/0/home", body)).json()
    await bench.until_moving()
    stopped = await bench.post("/nodes/1/axes/0/stop")
    assert stopped.status_code == 200
    assert stopped.json()["moving"] is False
    ended = (await bench.get(f"/operations/{homing['id']}")).json()
    assert ended["state"] == "cancelled"
    assert ended["reason"]
    assert (await bench.axis())["referenced"] is False


async def test_a_node_switched_off_in_mid_move_fails_the_operation_with_what_to_do(bench: Bench) -> None:
    await bench.enable()
    operation = (await bench.move(10_000_000)).json()
    await bench.until_moving()
    bench.module.power_off()
    ended = (await bench.get(f"/operations/{operation['id']}?wait=30")).json()
    assert ended["state"] == "failed"
    assert ended["error"]["detail"]
    assert ended["error"]["hint"]
    assert ended["error"]["status"] == 503
    node = bench.service.network.node(1)
    await bench.until(lambda: node.status().state == "lost")
    refused = await bench.move(1)
    assert refused.status_code == 503
    assert refused.json()["code"] == "node_away"
    assert refused.json()["hint"]
    assert (await bench.client.get("/readyz")).status_code == 503
    assert (await bench.axis())["stale"] is True


async def test_a_node_that_comes_back_must_be_enabled_anew(bench: Bench) -> None:
    await bench.enable()
    bench.module.power_off()
    node = bench.service.network.node(1)
    await bench.until(lambda: node.status().state == "lost")
    bench.module.power_on()
    await bench.until_ready()
    assert (await bench.axis())["state"] == "switch_on_disabled"
    await bench.enable()
    assert (await bench.move(500, wait=60)).json()["state"] == "succeeded"


async def test_what_runs_is_known_however_many_ended_since_it_began(bench: Bench) -> None:
    await bench.enable()
    running_for_long = (await bench.move(10_000_000)).json()["id"]
    await bench.until_moving()
    axis = bench.service.network.node(1).axis(1)
    for _ in range(KEPT + 1):
        other = never_begun(axis)
        other.give_up("It was not wanted.")
        bench.service.operations.add(other, {})
    assert [one["id"] for one in (await bench.get("/operations?state=running")).json()["operations"]] == [
        running_for_long
    ]
    cancelled = await bench.post(f"/operations/{running_for_long}/cancel")
    assert (cancelled.status_code, cancelled.json()["state"]) == (200, "cancelled")
    assert (await bench.axis())["moving"] is False
