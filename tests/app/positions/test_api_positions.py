"""Positions over HTTP: saying where an axis stands, and giving places names."""

from __future__ import annotations

import dataclasses
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from api_bench import Bench, running

from app.configuration.axes import AxisSettings
from app.configuration.configuration import Configuration, NodeSettings, StoreConfiguration
from app.configuration.measures import Measure

pytestmark = pytest.mark.looptime

LIMITS = [Measure(value=-5), Measure(value=40)]
MM = Configuration(
    nodes=(
        NodeSettings(
            id=1,
            name="stage",
            axes=(
                AxisSettings(name="x", unit="mm", steps_per_unit=1280, soft_limits=LIMITS),
                AxisSettings(name="y"),
            ),
        ),
    )
)


async def set_position(bench: Bench, body: dict[str, Any], axis: str = "x") -> Any:
    return await bench.post(f"/nodes/1/axes/{axis}/set-position?wait=20", body)


async def test_the_axis_is_where_it_is_said_to_be() -> None:
    async with running(MM) as bench:
        await bench.until_ready()
        response = await set_position(bench, {"position": 12.5, "unit": "mm"})
        operation = response.json()
        assert (response.status_code, operation["state"]) == (200, "succeeded"), operation
        assert operation["kind"] == "set_position"
        assert operation["request"]["position_steps"] == 16_000
        assert operation["result"]["position"] == {"steps": 16_000, "value": 12.5, "unit": "mm"}
        axis = await bench.axis("x")
        assert axis["position"] == operation["result"]["position"]
        assert (axis["referenced"], axis["reference"]) == (True, "homed")
        (track,) = operation["evidence"]["axes"]
        assert (track["start"]["steps"], track["end"]["steps"]) == (0, 16_000)


UNFIT = [
    ({"position": 40.1, "unit": "mm"}, 422, "bad_value"),
    ({"position": 1, "unit": "inch"}, 422, "bad_value"),
    ({"position": 2**31, "unit": "steps"}, 422, "bad_value"),
    ({"position": 1}, 422, "bad_request"),
    ({"position": "here", "unit": "mm"}, 422, "bad_request"),
]


async def test_what_can_t_be_is_refused_and_leaves_no_operation() -> None:
    async with running(MM) as bench:
        await bench.until_ready()
        for body, status, code in UNFIT:
            response = await set_position(bench, body)
            assert (response.status_code, response.json()["code"]) == (status, code), body
        assert (await bench.get("/operations")).json()["operations"] == []


async def test_limits_of_a_homed_axis_move_only_with_a_word() -> None:
    async with running(MM) as bench:
        await bench.until_ready()
        await set_position(bench, {"position": 10, "unit": "mm"})
        refused = await set_position(bench, {"position": 0, "unit": "mm"})
        assert refused.status_code == 409
        assert [o["code"] for o in refused.json()["obstacles"]] == ["limits_would_shift"]
        meant = await set_position(bench, {"position": 0, "unit": "mm", "shift_limits": True})
        assert meant.json()["state"] == "succeeded"


async def test_it_is_refused_while_the_axis_moves(bench: Bench) -> None:
    await bench.enable()
    await bench.move(2_000_000)
    refused = await set_position(bench, {"position": 0, "unit": "steps"}, "0")
    assert (refused.status_code, refused.json()["code"]) == (409, "axis_busy")


# --- named positions ---


POSITIONS = "/nodes/stage/axes/x/positions"


async def teach(bench: Bench, name: str, body: dict[str, Any] | None = None) -> Any:
    return await bench.put(f"{POSITIONS}/{name}", body or {})


async def go(bench: Bench, name: str, **more: Any) -> Any:
    return await bench.post("/nodes/1/axes/x/move?wait=20", {"position": name, **more})


@pytest.fixture
async def homed() -> AsyncIterator[Bench]:
    """A service whose axis x is in mm, homed and enabled."""
    async with running(MM) as bench:
        await bench.until_ready()
        await set_position(bench, {"position": 0, "unit": "mm"})
        await bench.enable("x")
        yield bench


async def test_a_position_is_told_or_taught_and_gone_to(homed: Bench) -> None:
    told = (await teach(homed, "load", {"position": 2.5, "unit": "mm"})).json()
    assert told["position"] == {"steps": 3200, "value": 2.5, "unit": "mm"}
    assert (told["within_limits"], told["unreferenced"], told["taught_by"]) == (True, False, "anonymous")
    moved = (await go(homed, "load", velocity=50, unit="mm")).json()
    assert moved["state"] == "succeeded", moved
    assert moved["request"]["position"] == "load"
    assert moved["request"]["target_steps"] == moved["result"]["position"]["steps"] == 3200
    assert moved["request"]["velocity"] == 64_000
    await homed.move(4000, axis="x", wait=20)
    assert (await teach(homed, "here", {"unit": "um"})).json()["position"] == {
        "steps": 4000,
        "value": 3125.0,
        "unit": "um",
    }
    listed = (await homed.get(POSITIONS)).json()["positions"]
    assert [position["name"] for position in listed] == ["here", "load"]
    assert (await homed.get("/nodes/1/axes/0/positions/load")).json() == told
    assert (await homed.get("/nodes/1/axes/1/positions")).json()["positions"] == []
    assert (await go(homed, "load")).json()["result"]["position"]["value"] == 2.5


async def test_a_position_is_taught_anew_and_forgotten(homed: Bench) -> None:
    await teach(homed, "park", {"position": 1, "unit": "mm"})
    await teach(homed, "park", {"position": 2, "unit": "mm"})
    gone = await homed.client.request("DELETE", f"/api/v1{POSITIONS}/park", json={})
    assert (gone.status_code, gone.json()["position"]["value"]) == (200, 2.0)
    assert (await homed.get(POSITIONS)).json()["positions"] == []
    for response in (
        await homed.get(f"{POSITIONS}/park"),
        await homed.client.request("DELETE", f"/api/v1{POSITIONS}/park", json={}),
        await go(homed, "park"),
    ):
        assert (response.status_code, response.json()["code"]) == (404, "unknown_position")


async def test_beyond_the_limits_nothing_is_taught_and_nobody_goes(homed: Bench) -> None:
    refused = await teach(homed, "far", {"position": 40.5, "unit": "mm"})
    assert (refused.status_code, refused.json()["code"]) == (422, "bad_value")
    await teach(homed, "edge", {"position": 40, "unit": "mm"})
    axis = homed.service.network.node(1).axis("x")
    axis.go_by(dataclasses.replace(axis.config, soft_limits=(0, 1000)))
    await set_position(homed, {"position": 0, "unit": "mm"})
    assert not (await homed.get(f"{POSITIONS}/edge")).json()["within_limits"]
    refused = await go(homed, "edge")
    assert (refused.status_code, refused.json()["code"]) == (422, "bad_value")
    assert (await homed.axis("x"))["position"]["steps"] == 0


async def test_where_a_moving_axis_is_is_not_taught(homed: Bench) -> None:
    await homed.post("/nodes/1/axes/x/move", {"target": 30, "unit": "mm"})
    await homed.until_moving()
    refused = await teach(homed, "passing")
    assert [o["code"] for o in refused.json()["obstacles"]] == ["turning"]
    assert refused.status_code == 409


async def test_without_a_reference_only_who_says_so_teaches_and_goes() -> None:
    async with running(MM) as bench:
        await bench.until_ready()
        await bench.enable("x")
        refused = await teach(bench, "start")
        assert [o["code"] for o in refused.json()["obstacles"]] == ["not_referenced"]
        await teach(bench, "told", {"position": 1, "unit": "mm"})
        refused = await go(bench, "told")
        assert (refused.status_code, [o["code"] for o in refused.json()["obstacles"]]) == (
            409,
            ["not_referenced"],
        )
        await teach(bench, "start", {"unreferenced": True})
        assert (await bench.get(f"{POSITIONS}/start")).json()["unreferenced"]
        assert (await go(bench, "start")).json()["state"] == "succeeded"


async def test_a_node_that_is_away_teaches_nothing_but_what_it_is_told() -> None:
    async with running(MM, powered=False) as bench:
        refused = await teach(bench, "here", {"unreferenced": True})
        assert (refused.status_code, refused.json()["code"]) == (503, "node_away")
        assert (await teach(bench, "told", {"position": 1, "unit": "mm"})).status_code == 200


MISFITS = [
    ({"position": "park", "target": 5}, "target"),
    ({"position": "park", "relative": True}, "relative"),
    ({"position": 5}, "position"),
    ({"position": "../x"}, "position"),
    ({"position": "park", "velocity": 5}, "body"),
    ({"unit": "mm"}, "target"),
    ({"target": "park", "unit": "mm"}, "target"),
]


async def test_a_move_takes_a_target_or_a_name(homed: Bench) -> None:
    for body, field in MISFITS:
        refused = await homed.post("/nodes/1/axes/x/move", body)
        assert refused.status_code == 422, body
        assert [error["field"] for error in refused.json()["errors"]] == [field]


async def test_bodies_and_names_that_can_t_be_are_422(homed: Bench) -> None:
    for name, body in (
        ("park", {"position": 1}),
        ("park", {"position": True, "unit": "mm"}),
        ("park", {"position": 1, "unit": "inch"}),
        ("-park", {}),
        ("p" * 65, {}),
        ("a%2Fb%20", {}),
    ):
        refused = await teach(homed, name, body)
        assert refused.status_code in (404, 422), (name, body)
    assert (await homed.get(POSITIONS)).json()["positions"] == []


async def test_positions_outlive_the_service_and_a_broken_store(tmp_path: Path) -> None:
    path = tmp_path / "store" / "canaxis.db"
    configuration = MM.model_copy(update={"store": StoreConfiguration(file=path)})
    async with running(configuration) as bench:
        await bench.until_ready()
        taught = (await teach(bench, "park", {"position": 3, "unit": "mm"})).json()
    async with running(configuration) as bench:
        await bench.until_ready()
        assert (await bench.get(f"{POSITIONS}/park")).json() == taught
        store = bench.service.store
        store._turn_off("The disk is broken.")
        off = await teach(bench, "other", {"position": 4, "unit": "mm"})
        assert (off.status_code, off.json()["code"]) == (503, "store_off")
        gone = await bench.client.request("DELETE", f"/api/v1{POSITIONS}/park", json={})
        assert (gone.status_code, gone.json()["code"]) == (503, "store_off")
        assert (await bench.get(POSITIONS)).json()["positions"] == [taught]
        await set_position(bench, {"position": 0, "unit": "mm"})
        await bench.enable("x")
        assert (await go(bench, "park")).json()["state"] == "succeeded"
        store._turn_on()
        assert (await teach(bench, "other", {"position": 4, "unit": "mm"})).status_code == 200
        assert [p["name"] for p in (await bench.get(POSITIONS)).json()["positions"]] == ["other", "park"]


async def test_positions_that_could_never_be_read_are_not_said_to_be_none(tmp_path: Path) -> None:
    (tmp_path / "canaxis.db").mkdir()
    configuration = MM.model_copy(update={"store": StoreConfiguration(file=tmp_path / "canaxis.db")})
    async with running(configuration) as bench:
        listed = await bench.get(POSITIONS)
        assert (listed.status_code, listed.json()["code"]) == (503, "store_off")
