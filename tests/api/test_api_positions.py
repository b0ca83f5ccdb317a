"""Positions over HTTP: saying where an axis stands."""

from __future__ import annotations

from typing import Any

import pytest
from api_bench import Bench, running

from app.settings import AxisSettings, NodeSettings, Settings

MM = Settings(
    nodes=(
        NodeSettings(
            id=1,
            name="stage",
            axes=(
                AxisSettings(name="x", unit="mm", steps_per_unit=1280, soft_limits=(-5, 40)),
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


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        ({"position": 40.1, "unit": "mm"}, 422, "bad_value"),
        ({"position": 1, "unit": "inch"}, 422, "bad_value"),
        ({"position": 2**31, "unit": "steps"}, 422, "bad_value"),
        ({"position": 1}, 422, "bad_request"),
        ({"position": "here", "unit": "mm"}, 422, "bad_request"),
    ],
)
async def test_what_can_t_be_is_refused_and_leaves_no_operation(
    body: dict[str, Any], status: int, code: str
) -> None:
    async with running(MM) as bench:
        await bench.until_ready()
        response = await set_position(bench, body)
        assert (response.status_code, response.json()["code"]) == (status, code)
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
