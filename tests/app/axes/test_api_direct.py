"""Plain requests about an axis take a shorter way than others, and nobody can tell by the answer."""

from __future__ import annotations

import pytest
from api_bench import Bench
from fastapi import APIRouter, Depends

from app.axes.deps import AxisDep
from app.axes.direct import AxisRoute
from app.axes.schemas import AxisStatusReply

pytestmark = pytest.mark.looptime

CAREFUL = {"Idempotency-Key": "k"}
"""On a request that heeds no key: it changes nothing but the way."""


@pytest.mark.parametrize("path", ["/nodes/1/axes/0", "/nodes/stage/axes/x", "/nodes/1/axes/0/readiness"])
async def test_both_ways_give_the_same_answer(bench: Bench, path: str):
    short = await bench.get(path)
    long = await bench.get(path, headers=CAREFUL)
    assert short.status_code == long.status_code == 200
    ageless = [{k: v for k, v in reply.json().items() if k != "age_s"} for reply in (short, long)]
    assert ageless[0] == ageless[1]
    assert list(short.json()) == list(long.json())
    assert short.headers["content-type"] == long.headers["content-type"]


@pytest.mark.parametrize("path", ["/nodes/9/axes/0", "/nodes/1/axes/9", f"/nodes/{'n' * 65}/axes/0"])
async def test_both_ways_refuse_alike(bench: Bench, path: str):
    short = await bench.get(path)
    long = await bench.get(path, headers=CAREFUL)
    assert short.status_code == long.status_code >= 400
    assert short.json() == long.json()


async def test_a_command_with_a_body_is_still_checked(bench: Bench):
    response = await bench.post("/nodes/1/axes/0/enable", {"force": True})
    assert response.status_code == 422
    assert response.json()["errors"][0]["field"] == "force"
    assert (await bench.axis())["state"] == "switch_on_disabled"


async def test_a_plain_command_is_measured_under_its_operation(bench: Bench):
    await bench.enable("0")
    assert (await bench.post("/nodes/1/axes/0/stop")).status_code == 200
    metrics = (await bench.client.get("/metrics")).text
    assert 'canaxis_http_request_duration_seconds_count{operation="stop_axis",status="200"} 1.0' in metrics


async def test_the_halt_is_sent_before_anything_else_gets_its_turn(bench: Bench):
    await bench.enable("0")
    axis = bench.service.network.node(1).axis(0)
    halted: list[bool] = []
    whole = axis.stop

    def look(*arguments: str):
        halted.append(axis._drive.halted)
        return whole(*arguments)

    axis.stop = look  # pyright: ignore[reportAttributeAccessIssue]
    assert (await bench.post("/nodes/1/axes/0/stop")).status_code == 200
    assert halted == [True]


async def role() -> None:
    """A dependency that guards something."""


async def test_what_the_short_way_would_pass_over_is_refused_at_once():
    router = APIRouter(route_class=AxisRoute)

    async def endpoint(axis: AxisDep) -> AxisStatusReply:
        raise AssertionError(axis.name)

    async def curious(axis: AxisDep, detail: bool = False) -> AxisStatusReply:
        raise AssertionError(axis.name, detail)

    with pytest.raises(TypeError, match="role"):
        router.get("/nodes/{node}/axes/{axis}/a", dependencies=[Depends(role)])(endpoint)
    with pytest.raises(TypeError, match="detail"):
        router.get("/nodes/{node}/axes/{axis}/b")(curious)
