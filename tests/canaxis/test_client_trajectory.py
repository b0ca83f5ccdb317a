"""A path as the client sends it: piece by piece, from a generator too."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Iterator

import httpx
import pytest
from api_bench import Bench

from canaxis import AsyncClient, Client
from canaxis.contract.exchange import Request
from canaxis.contract.path import PathBody, TrajectoryPoint

AXES = [("stage", "x", "steps"), (1, 1, "steps")]


def points(count: int = 3) -> Iterator[TrajectoryPoint]:
    for number in range(count):
        yield number / 10, (100 * number, -50 * number), (0, 0)


def test_a_generator_is_taken_piece_by_piece_and_only_once() -> None:
    taken = 0

    def counted() -> Iterator[TrajectoryPoint]:
        nonlocal taken
        for point in points(2000):
            taken += 1
            yield point

    body = PathBody(AXES, counted(), 20)
    assert not body.repeatable
    pieces = body.pieces()
    text = next(pieces) + next(pieces)
    assert taken == 500
    text += b"".join(pieces)
    said = json.loads(text)
    assert (said["cycle_ms"], len(said["points"])) == (20, 2000)
    assert said["axes"][1] == {"node": 1, "axis": 1, "unit": "steps"}
    assert said["points"][2] == {"t": 0.2, "positions": [200, -100], "velocities": [0, 0]}


@pytest.mark.parametrize("count", [0, 1, 499, 500, 501, 1000])
def test_any_number_of_points_is_json(count: int) -> None:
    body = PathBody(AXES, [(n, (0,)) for n in range(count)], 10)
    assert body.repeatable
    assert [point["t"] for point in json.loads(b"".join(body.pieces()))["points"]] == list(range(count))


def test_what_can_not_be_asked_for_again_is_not_sent_again() -> None:
    keyed = {"Idempotency-Key": "k"}
    assert Request("POST", "/", path_body=PathBody(AXES, [], 10), headers=keyed).repeatable
    assert not Request("POST", "/", path_body=PathBody(AXES, points(), 10), headers=keyed).repeatable


def test_points_that_come_asynchronously_need_the_other_client() -> None:
    async def later() -> AsyncIterator[TrajectoryPoint]:
        yield 0.0, (0,)

    with Client("http://x", http=httpx.Client()) as client, pytest.raises(TypeError, match="AsyncClient"):
        client.trajectory(AXES, later())  # pyright: ignore[reportArgumentType] - the mistake in question


async def test_a_path_is_followed(bench: Bench) -> None:
    async def later() -> AsyncIterator[TrajectoryPoint]:
        for point in points():
            yield point

    client = AsyncClient(str(bench.client.base_url), http=bench.client)
    for name in "xy":
        await client.node("stage").axis(name).enable()
    operation = await client.trajectory(AXES, later(), cycle_ms=20)
    await operation.wait(timeout=30)
    assert operation.state == "succeeded"
    assert operation.status.result is not None
    assert operation.status.result["cycle_ms"] == 20
