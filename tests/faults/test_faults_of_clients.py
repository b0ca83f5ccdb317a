"""Clients that are slow, hang, go away, or want the same axis."""

from __future__ import annotations

import asyncio
import json

import pytest
from api_bench import Bench, EventClient
from fault_kit import FAR, ended, moving, refusal, truly_moving
from starlette.types import Message

from app.events import streams

pytestmark = pytest.mark.looptime


class SlowClient:
    """A stream's client that takes a chunk only every so often; None: never."""

    def __init__(self, bench: Bench, pause: float | None) -> None:
        self._bench = bench
        self._pause = pause
        self.text = ""
        self.chunks = 0

    async def run(self) -> None:
        await self._bench.app(EventClient(self._bench.app).scope(), self._receive, self._send)

    async def _receive(self) -> Message:
        await asyncio.Event().wait()
        raise AssertionError

    async def _send(self, message: Message) -> None:
        if message["type"] == "http.response.body":
            if self._pause is None:
                await asyncio.Event().wait()
            else:
                await asyncio.sleep(self._pause)
            self.text += message.get("body", b"").decode()
            self.chunks += 1


async def chatter(bench: Bench, count: int, pause: float = 0.001) -> None:
    for number in range(count):
        bench.service.network.events.publish("bus", data={"state": "active", "reason": f"chatter {number}"})
        await asyncio.sleep(pause)


async def test_a_slow_stream_client_is_told_and_let_go_and_others_feel_nothing(bench: Bench) -> None:
    slow = SlowClient(bench, 2.0)
    stream = asyncio.create_task(slow.run())
    async with EventClient(bench.app) as quick:
        await quick.next("snapshot")
        await asyncio.sleep(3)
        talk = asyncio.create_task(chatter(bench, 1000, 0.005))
        heard = [(await quick.next("bus")).data["reason"] for _ in range(1000)]
        await talk
        assert heard == [f"chatter {number}" for number in range(1000)], "the other one misses nothing"
    await asyncio.wait_for(stream, 60)
    lines = slow.text.split("\n")
    last = len(lines) - 1 - lines[::-1].index("event: missed")
    assert json.loads(lines[last + 1].removeprefix("data: "))["missed"] > 0
    assert lines[last + 2 :] == ["", ""], "with that its stream ends"
    assert slow.chunks < 20, "what came meanwhile was put together"


async def test_a_hung_stream_client_is_let_go_and_others_feel_nothing(bench: Bench) -> None:
    hung = SlowClient(bench, None)
    stream = asyncio.create_task(hung.run())
    async with EventClient(bench.app) as quick:
        await quick.next("snapshot")
        await chatter(bench, 2000)
        assert bench.service.streams.missed == 2000 - streams.CAPACITY, "its queue is bounded"
        await bench.enable()
        assert (await bench.move(1000, wait=30)).json()["state"] == "succeeded"
        await asyncio.wait_for(stream, streams.HUNG + 1)
        await bench.post("/stop", {"reason": "still served"})
        assert (await quick.next("stop")).data["reason"] == "still served"
        assert len(bench.service.streams) == 1


async def test_a_client_that_goes_in_mid_move_changes_nothing(bench: Bench) -> None:
    await bench.enable()
    waiting = asyncio.create_task(bench.move(40_000, wait=600))
    await bench.until_moving()
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)
    [operation] = (await bench.get("/operations")).json()["operations"]
    assert operation["state"] == "running"
    assert (await ended(bench, operation))["state"] == "succeeded"
    assert (await bench.axis())["position"]["steps"] == 40_000


async def test_a_move_whose_client_went_can_be_stopped_by_anybody(bench: Bench) -> None:
    await bench.enable()
    waiting = asyncio.create_task(bench.move(FAR, wait=600))
    await bench.until_moving()
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)
    assert truly_moving(bench)
    assert (await bench.client.post("/api/v1/nodes/1/axes/0/stop")).json()["moving"] is False
    assert not truly_moving(bench)


async def test_of_two_clients_on_one_axis_the_second_learns_what_holds_it(bench: Bench) -> None:
    operation = await moving(bench)
    for command, body in (
        ("move", {"target": 5, "unit": "steps"}),
        ("velocity", {"velocity": 1000, "unit": "steps"}),
        ("home", {"method": 35}),
        ("enable", None),
    ):
        refused = await bench.post(f"/nodes/1/axes/0/{command}", body)
        if command == "enable" and refused.status_code == 200:
            continue  # it is enabled; that is no second command
        assert refusal(refused)[0] == 409, command
    refused = await bench.move(5)
    assert refusal(refused) == (409, "axis_busy")
    assert refused.json()["operation"] == operation["links"]["self"]
    assert (await bench.get(operation["links"]["self"].removeprefix("/api/v1"))).json()["state"] == "running"


async def test_commands_at_the_same_moment_are_served_one_after_the_other(bench: Bench) -> None:
    await bench.enable()
    answers = await asyncio.gather(*(bench.move(1000 * n, wait=60) for n in range(1, 9)))
    assert sorted(answer.status_code for answer in answers) == [200] + [409] * 7
    [first] = [answer.json() for answer in answers if answer.status_code == 200]
    assert first["state"] == "succeeded"
    assert (await bench.axis())["position"]["steps"] == first["request"]["target_steps"]


async def test_a_stop_ends_what_both_want_and_nothing_starts_again_by_itself(bench: Bench) -> None:
    await bench.enable()
    first = asyncio.create_task(bench.move(FAR, wait=600))
    await bench.until_moving()
    second = asyncio.create_task(bench.move(-FAR, wait=600))
    assert (await bench.client.post("/api/v1/nodes/1/axes/0/stop")).json()["moving"] is False
    assert (await first).json()["state"] == "cancelled"
    assert (await second).status_code == 409
    rest = (await bench.axis())["position"]["steps"]
    await asyncio.sleep(30)
    assert not truly_moving(bench)
    assert (await bench.axis())["position"]["steps"] == rest
    assert [each["state"] for each in (await bench.get("/operations")).json()["operations"]] == ["cancelled"]


async def test_after_the_stop_for_everything_nothing_starts_even_when_it_is_reset(bench: Bench) -> None:
    await bench.enable("0", "1")
    waiting = [asyncio.create_task(bench.move(FAR, axis=axis, wait=600)) for axis in "01"]
    await bench.until_moving(0)
    await bench.until_moving(1)
    assert (await bench.client.post("/api/v1/stop")).json()["complete"] is True
    assert {(await each).json()["state"] for each in waiting} == {"cancelled"}
    assert refusal(await bench.move(1)) == (409, "stop_latched")
    await bench.post("/stop/reset")
    await asyncio.sleep(30)
    assert not truly_moving(bench, 0)
    assert not truly_moving(bench, 1)
