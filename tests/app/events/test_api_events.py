"""The event stream: snapshot first, then changes; replay, keep-alive, limits and ends."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

import pytest
from api_bench import Bench, EventClient, running
from starlette.types import Message

from app.configuration.configuration import Configuration

pytestmark = pytest.mark.looptime


async def test_a_snapshot_comes_first_with_everything(bench: Bench) -> None:
    async with EventClient(bench.app) as events:
        first = await events.next()
        assert events.status == 200
        assert events.headers[b"content-type"].startswith(b"text/event-stream")
        assert events.headers[b"cache-control"] == b"no-cache"
    assert first.kind == "snapshot"
    assert first.id is not None
    assert 0 < first.id <= bench.service.network.events.last_id
    assert [a["axis"] for a in first.data["axes"]] == [0, 1, 2]
    assert first.data["nodes"][0]["state"] == "operational"
    assert first.data["stop"]["latched"] is False
    assert first.data["bus"]["state"] == "active"
    axis = await bench.axis()
    assert set(first.data["axes"][0]) == set(axis), "the same shape as GET gives"


async def test_changes_follow_with_rising_ids(bench: Bench) -> None:
    async with EventClient(bench.app) as events:
        snapshot = await events.next("snapshot")
        await bench.enable()
        operation = (await bench.move(20000, wait=30)).json()
        seen = []
        while not (seen and seen[-1].kind == "motion" and seen[-1].data["state"] == "succeeded"):
            seen.append(await events.next())
    ids = [event.id for event in seen]
    assert ids == sorted(ids)
    assert min(ids) > snapshot.id
    states = [e.data["state"] for e in seen if e.kind == "motion" and e.data["id"] == operation["id"]]
    assert states[-1] == "succeeded"
    assert any(e.kind == "axis" and e.data["moving"] for e in seen)


async def test_a_stop_is_told(bench: Bench) -> None:
    async with EventClient(bench.app) as events:
        await events.next("snapshot")
        await bench.post("/stop", {"reason": "told"})
        event = await events.next("stop")
    assert event.data["latched"] is True
    assert event.data["reason"] == "told"


async def test_a_client_that_comes_back_gets_what_it_missed_then_a_snapshot(bench: Bench) -> None:
    async with EventClient(bench.app) as events:
        known = (await events.next("snapshot")).id
    await bench.post("/stop", {"reason": "missed"})
    await bench.post("/stop/reset")
    async with EventClient(bench.app, last_event_id=str(known)) as events:
        first = await events.next()
        assert (first.kind, first.data["reason"]) == ("stop", "missed")
        assert known is not None
        assert first.id is not None
        assert first.id > known
        second = await events.next()
        assert (second.kind, second.data["latched"]) == ("stop", False)
        assert (await events.next()).kind == "snapshot"


@pytest.mark.parametrize("last_event_id", ["999999999", "0"])
async def test_what_is_not_kept_any_more_is_said(bench: Bench, last_event_id: str) -> None:
    hub = bench.service.network.events
    for _ in range(1200):
        hub.publish("bus", data={"state": "active", "reason": ""})
    async with EventClient(bench.app, last_event_id=last_event_id) as events:
        assert (await events.next()).kind == "missed"
        assert (await events.next()).kind == "snapshot"


@pytest.mark.parametrize("last_event_id", ["", "x", "-1", "٣"])
async def test_a_last_event_id_that_is_none_is_ignored(bench: Bench, last_event_id: str) -> None:
    async with EventClient(bench.app, last_event_id=last_event_id) as events:
        assert (await events.next()).kind == "snapshot"


async def test_every_client_gets_the_same_bytes_encoded_once(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from app.events import streams

    encoded: list[str] = []
    real = streams.encode

    def counting(kind: str, data: object, event_id: int | None = None) -> bytes:
        encoded.append(kind)
        return real(kind, data, event_id)

    async with EventClient(bench.app) as one, EventClient(bench.app) as two, EventClient(bench.app) as three:
        clients = (one, two, three)
        for client in clients:
            await client.next("snapshot")
        monkeypatch.setattr(streams, "encode", counting)
        await bench.post("/stop", {"reason": "once"})
        answers = [await client.next("stop") for client in clients]
    assert answers[0] == answers[1] == answers[2]
    assert encoded.count("stop") == 1


async def test_a_quiet_stream_is_kept_open() -> None:
    async with running(powered=False) as bench, EventClient(bench.app) as events:
        await events.next("snapshot")
        await asyncio.sleep(60)  # virtual seconds, for the keep-alive's timer
        await bench.post("/stop")
        await events.next("stop")
        assert events.comments >= 1


async def test_too_many_streams_are_refused_and_a_closed_one_makes_room() -> None:
    configuration = Configuration.model_validate({"server": {"max_streams": 1}})
    async with running(configuration) as bench:
        async with EventClient(bench.app) as events:
            await events.next("snapshot")
            refused = await bench.get("/events")
            assert refused.status_code == 503
            assert refused.json()["code"] == "too_many_streams"
        await bench.until(lambda: len(bench.service.streams) == 0)
        async with EventClient(bench.app) as events:
            assert (await events.next()).kind == "snapshot"


async def test_streams_end_when_the_service_does(bench: Bench) -> None:
    async with EventClient(bench.app) as events:
        await events.next("snapshot")
        bench.service.begin_shutdown()
        assert "shutting down" in (await events.next("stop")).data["reason"]
        assert await events.ended()
    refused = await bench.get("/events")
    assert (refused.status_code, refused.json()["code"]) == (503, "shutting_down")


async def test_a_client_that_does_not_read_is_told_how_much_it_missed_and_let_go(bench: Bench) -> None:
    hub = bench.service.network.events
    async with EventClient(bench.app) as events:
        last = (await events.next("snapshot")).id
        for number in range(400):
            hub.publish("bus", data={"state": "active", "reason": str(number)})
        missed = await events.next("missed")
        assert missed.data["missed"] == 400 - 256
        assert missed.id is None, "it comes back with the id of the last event that it got"
        assert await events.ended()
    async with EventClient(bench.app, last_event_id=str(last)) as events:
        again = [(await events.next("bus")).data["reason"] for _ in range(400)]
        assert again == [str(number) for number in range(400)], "nothing is lost to who comes back"
        assert (await events.next()).kind == "snapshot"


async def test_a_last_event_id_beyond_all_bounds_is_ignored_too(bench: Bench) -> None:
    for last_event_id in ("9" * 5000, "x" * 300):
        async with EventClient(bench.app, last_event_id=last_event_id) as events:
            assert (await events.next()).kind == "snapshot"


async def test_a_client_that_takes_nothing_is_let_go(bench: Bench) -> None:
    """Its place and its queue are free again; what it lost counts at once, not only at its end."""
    hanging = asyncio.Event()

    async def send(message: Message) -> None:
        if message["type"] == "http.response.body":
            hanging.set()
            await asyncio.Event().wait()

    async def receive() -> Message:
        await asyncio.Event().wait()
        raise AssertionError

    client = EventClient(bench.app)
    stream = asyncio.create_task(bench.app(client.scope(), receive, send))
    await hanging.wait()
    for number in range(300):
        bench.service.network.events.publish("bus", data={"state": "active", "reason": str(number)})
    assert (len(bench.service.streams), bench.service.streams.missed) == (1, 300 - 256)
    await asyncio.wait_for(stream, 60)
    assert len(bench.service.streams) == 0
    assert bench.service.streams.missed >= 300 - 256


async def test_two_hundred_clients_get_a_stop_from_one_encoding(monkeypatch: pytest.MonkeyPatch) -> None:
    from app.events import streams

    encoded = 0
    real = streams.encode

    def counting(kind: str, data: object, event_id: int | None = None) -> bytes:
        nonlocal encoded
        encoded += kind == "stop"
        return real(kind, data, event_id)

    configuration = Configuration.model_validate({"server": {"max_streams": 200}})
    async with running(configuration, powered=False) as bench, AsyncExitStack() as stack:
        clients = [await stack.enter_async_context(EventClient(bench.app)) for _ in range(200)]
        for client in clients:
            await client.next("snapshot")
        monkeypatch.setattr(streams, "encode", counting)
        await bench.post("/stop", {"reason": "all"})
        for client in clients:
            assert (await client.next("stop")).data["reason"] == "all"
    assert encoded == 1
