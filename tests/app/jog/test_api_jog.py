"""Jogging by WebSocket, on the bare ASGI application and a virtual clock."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from api_bench import App, Bench, running
from starlette.types import Message

from app.access.roles import Role
from app.access.tokens import add_token
from app.configuration.configuration import Configuration
from app.jog.outbox import CAPACITY, Outbox, Overflow
from app.jog.schemas import PongMessage
from app.jog.socket import HUNG, PER_SECOND, STATUS
from drivers.sim.snapshot import AxisSnapshot, take

pytestmark = pytest.mark.looptime

SPEED, RATE = 50_000, 100_000
RAMP = SPEED / RATE
SILENCE = 0.5
LATE = 0.05
"""Seconds that a stop and what tells of it may be under way."""


class JogClient:
    """A browser's WebSocket, as far as a jog needs it."""

    def __init__(self, app: App, axis: str = "x", *, query: str = "", **headers: str) -> None:
        self._app = app
        self._path = f"/api/v1/nodes/stage/axes/{axis}/jog"
        self._query = query
        self._headers = {"host": "127.0.0.1:8402", **headers}
        self._inbox: asyncio.Queue[Message] = asyncio.Queue()
        self._said: deque[Any] = deque()
        self._news = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._seq = 0
        self.stamp: float = 0
        self.stamped_at = now()
        self.reads = asyncio.Event()
        self.reads.set()
        self.closed: tuple[int, str] | None = None
        self.statuses = 0

    async def __aenter__(self) -> JogClient:
        scope = {
            "type": "websocket", "asgi": {"version": "3.0", "spec_version": "2.4"}, "http_version": "1.1",
            "scheme": "ws", "path": self._path, "raw_path": self._path.encode(), "root_path": "",
            "query_string": self._query.encode(), "subprotocols": [],
            "headers": [(k.encode(), v.encode()) for k, v in self._headers.items()],
            "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 8402),
        }  # fmt: skip
        self._inbox.put_nowait({"type": "websocket.connect"})
        self._task = asyncio.create_task(self._app(scope, self._inbox.get, self._receive))
        return self

    async def __aexit__(self, *_: object) -> None:
        self.vanish()
        assert self._task is not None
        await asyncio.wait_for(self._task, 60)

    def vanish(self) -> None:
        """The connection is gone, as the server hears of it."""
        self._inbox.put_nowait({"type": "websocket.disconnect", "code": 1006})

    async def _receive(self, message: Message) -> None:
        await self.reads.wait()
        if message["type"] == "websocket.close":
            self.closed = (message["code"], message["reason"])
        elif message["type"] == "websocket.send":
            said = json.loads(message["text"])
            self.stamp, self.stamped_at = said["stamp"], now()
            if said["kind"] == "status":
                self.statuses += 1
            self._said.append(said)
        self._news.set()

    async def next(self, *kinds: str, within: float = 30.0) -> Any:
        """The next message of one of these kinds."""
        async with asyncio.timeout(within):
            while True:
                while self._said:
                    if (said := self._said.popleft())["kind"] in kinds:
                        return said
                assert self.closed is None, self.closed
                self._news.clear()
                await self._news.wait()

    async def until_closed(self) -> tuple[int, str]:
        async with asyncio.timeout(30):
            while self.closed is None:
                self._news.clear()
                await self._news.wait()
        return self.closed

    def say_raw(self, text: str | None) -> None:
        """Any text, or None for bytes."""
        self._inbox.put_nowait(
            {"type": "websocket.receive", "bytes": b"\x00"}
            if text is None
            else {"type": "websocket.receive", "text": text}
        )

    def say(self, kind: str, **fields: Any) -> None:
        self.say_raw(json.dumps({"kind": kind, **fields}))

    def hold(self, velocity: float = SPEED, **fields: Any) -> None:
        self._seq += 1
        given = {"seq": self._seq, "velocity": velocity, "unit": "steps", "acceleration": RATE}
        age = (now() - self.stamped_at) * 1000
        self.say("hold", **given | {"echo": self.stamp, "echo_age_ms": age} | fields)

    async def hold_for(self, seconds: float, velocity: float = SPEED) -> None:
        for _ in range(round(seconds / 0.2)):
            self.hold(velocity)
            await asyncio.sleep(0.2)


def now() -> float:
    return asyncio.get_running_loop().time()


def truly(bench: Bench, axis: int = 0) -> AxisSnapshot:
    return take(1, bench.module, ()).axes[axis]


async def until_rest(bench: Bench, within: float = 10.0) -> float:
    """When the motor truly stands."""
    async with asyncio.timeout(within):
        while truly(bench).moving:  # noqa: ASYNC110 - the clock is virtual
            await asyncio.sleep(0.005)
    return now()


async def operations(bench: Bench) -> list[dict[str, Any]]:
    return (await bench.get("/operations")).json()["operations"]


@asynccontextmanager
async def jogging(bench: Bench) -> AsyncIterator[JogClient]:
    """A client that holds; the axis is at full speed."""
    await bench.enable()
    async with JogClient(bench.app) as client:
        await client.next("hello")
        await client.hold_for(1.0)
        assert truly(bench).velocity == SPEED
        yield client


async def test_hold_to_move_release_to_stop(bench: Bench) -> None:
    await bench.enable()
    async with JogClient(bench.app) as client:
        hello = await client.next("hello")
        assert (hello["keep_alive_ms"], hello["silence_ms"]) == (200, 500)
        assert hello["axis"]["name"] == "x"
        await client.hold_for(1.0)
        ack = await client.next("ack")
        assert (ack["seq"], ack["counts"], ack["outcome"], ack["jog"]) == (1, True, "begins", "starting")
        ack = await client.next("ack")
        assert (ack["seq"], ack["outcome"], ack["jog"]) == (2, "counts", "turning")
        assert ack["velocity"]["steps"] > 0
        assert ack["round_trip_ms"] == pytest.approx(0, abs=0.01)
        released = now()
        client.say("release")
        assert await until_rest(bench) - released <= RAMP + LATE
        stopped = await client.next("stopped")
        assert (stopped["reason"], stopped["result"]["holds"]) == ("released", 5)
        operation = (await bench.client.get(stopped["operation"])).json()
        assert (operation["kind"], operation["state"]) == ("jog", "succeeded")
        assert operation["request"]["velocity_steps"] == SPEED
        result = operation["result"]
        assert result["position"]["steps"] == result["travelled"]["steps"] == truly(bench).place > 0
        assert result["longest_gap_ms"] == pytest.approx(200)
        assert result["round_trip_max_ms"] == pytest.approx(0, abs=0.01)
        assert operation["evidence"]["statuswords"]


async def test_a_press_of_no_time_is_told_of_and_leaves_no_operation(bench: Bench) -> None:
    await bench.enable()
    async with JogClient(bench.app) as client:
        await client.next("hello")
        client.hold()
        client.say("release")
        stopped = await client.next("stopped")
        assert (stopped["reason"], stopped["operation"]) == ("released", None)
        assert await operations(bench) == []
        assert not truly(bench).moving


async def test_silence_stops_and_the_press_is_used_up_until_it_is_released(bench: Bench) -> None:
    async with jogging(bench) as client:
        client.hold()
        last = now()
        assert SILENCE < await until_rest(bench) - last <= SILENCE + RAMP + LATE
        stopped = await client.next("stopped")
        assert stopped["reason"] == "silence"
        assert (await bench.client.get(stopped["operation"])).json()["state"] == "cancelled"
        await client.hold_for(1.0)
        ack = await client.next("ack")
        while ack["outcome"] == "counts":
            ack = await client.next("ack")
        assert (ack["counts"], ack["outcome"], ack["jog"]) == (False, "used_up", "used_up")
        assert not truly(bench).moving, "the axis doesn't stutter"
        client.say("release")
        await client.hold_for(0.4)
        assert truly(bench).moving, "a fresh press"
        assert len(await operations(bench)) == 2


async def test_a_vanished_client_stops_the_axis_at_once(bench: Bench) -> None:
    async with jogging(bench) as client:
        gone = now()
        client.vanish()
        assert await until_rest(bench) - gone <= RAMP + LATE
    [operation] = await operations(bench)
    operation = (await bench.get(f"/operations/{operation['id']}?wait=5")).json()
    assert (operation["state"], operation["result"]["end"]) == ("cancelled", "closed")


async def test_what_comes_late_in_a_lump_moves_nothing(bench: Bench) -> None:
    async with jogging(bench) as client:
        stamp, at = client.stamp, client.stamped_at
        await until_rest(bench)
        await client.next("stopped")
        client.say("release")
        for _ in range(5):  # a new press of long ago, by what it had seen
            client.hold(echo=stamp, echo_age_ms=(now() - at) * 1000)
        await asyncio.sleep(0.5)
        assert not truly(bench).moving
        client.hold()
        await asyncio.sleep(0.1)
        assert truly(bench).moving


async def test_a_client_that_holds_but_doesn_t_read_is_stopped(bench: Bench) -> None:
    async with jogging(bench) as client:
        client.reads.clear()
        deaf = now()
        stamp = client.stamp
        holding = asyncio.create_task(client.hold_for(3.0))
        assert await until_rest(bench) - deaf <= 2 * SILENCE + RAMP + LATE
        assert client.stamp == stamp
        await holding
        client.reads.set()


async def test_a_client_that_takes_nothing_is_let_go(bench: Bench) -> None:
    await bench.enable()
    async with JogClient(bench.app) as client:
        await client.next("hello")
        client.reads.clear()
        await asyncio.sleep(HUNG + 0.5)
        client.reads.set()  # what it is told if it is there after all
        assert await client.until_closed() == (1013, "too_slow")
    assert len(bench.service.jogs) == 0


async def test_what_must_not_be_lost_is_bounded_and_others_feel_nothing(bench: Bench) -> None:
    async with jogging(bench) as client, JogClient(bench.app, "y") as flood:
        await flood.next("hello")
        flood.reads.clear()
        holding = asyncio.create_task(client.hold_for(1.0))
        await asyncio.sleep(0.5)  # by now a status is under way to it
        for number in range(CAPACITY + 2):
            flood.say("ping", echo=0, echo_age_ms=0, sent=number)
        await asyncio.sleep(0.3)
        flood.reads.set()
        assert await flood.until_closed() == (1013, "too_slow")
        await holding
        assert truly(bench).velocity == SPEED
        assert client.closed is None


async def test_a_loss_is_told_though_all_that_was_kept_is_sent() -> None:
    outbox = Outbox()
    for _ in range(CAPACITY + 1):
        outbox.put(lambda stamp: PongMessage(stamp=stamp, sent=0, round_trip_ms=None))
    sent = list(iter(outbox.take, None))
    assert len(sent) == CAPACITY
    with pytest.raises(Overflow):
        await outbox.wait(1)


@pytest.mark.parametrize("headers", [{"host": "evil.example:8402"}, {"origin": "http://evil.example"}])
async def test_a_page_of_elsewhere_opens_none_even_where_nobody_needs_a_token(
    bench: Bench, headers: dict[str, str]
) -> None:
    async with JogClient(bench.app, **headers) as client:
        code = "misdirected" if "host" in headers else "forbidden_origin"
        assert await client.until_closed() == (1008, code)
        assert client.stamp == 0, "nothing was said before"
    assert len(bench.service.jogs) == 0


async def test_so_many_are_open_at_most() -> None:
    async with running(Configuration.model_validate({"server": {"max_streams": 1}})) as bench:
        await bench.until_ready()
        async with JogClient(bench.app) as first, JogClient(bench.app) as second:
            assert (await second.next("problem"))["problem"]["code"] == "too_many_streams"
            assert await second.until_closed() == (4503, "too_many_streams")
            await first.next("hello")
        async with JogClient(bench.app) as third:
            await third.next("hello")


async def test_the_second_jog_of_an_axis_is_refused(bench: Bench) -> None:
    async with jogging(bench) as first, JogClient(bench.app) as second:
        await second.next("hello")
        first.hold()
        second.hold(-SPEED)
        problem = await second.next("problem")
        assert (problem["seq"], problem["problem"]["code"]) == (1, "axis_busy")
        [operation] = await operations(bench)
        assert problem["problem"]["operation"] == f"/api/v1/operations/{operation['id']}"
        await first.hold_for(0.4)
        assert truly(bench).velocity == SPEED
        first.say("release")
        await first.next("stopped")
        second.hold(-SPEED)
        assert (await second.next("ack"))["counts"] is False, "that press was refused"


async def test_an_axis_that_is_not_enabled_refuses_with_its_obstacles(bench: Bench) -> None:
    async with JogClient(bench.app) as client:
        await client.next("hello")
        client.hold()
        problem = (await client.next("problem"))["problem"]
        assert (problem["code"], problem["obstacles"][0]["code"]) == ("not_ready", "not_enabled")
        await asyncio.sleep(0.3)
        assert await operations(bench) == [], "none is left behind"


async def test_anybody_s_stop_ends_a_jog(bench: Bench) -> None:
    async with jogging(bench) as client:
        holding = asyncio.create_task(client.hold_for(2.0))
        stopped = await bench.post("/nodes/1/axes/0/stop")
        assert stopped.json()["moving"] is False
        assert (await client.next("stopped"))["reason"] == "stop"
        await holding
        assert not truly(bench).moving


async def test_a_fault_ends_a_jog(bench: Bench) -> None:
    async with jogging(bench) as client:
        bench.module.apply(lambda module, at: module.axes[0].short("a", at))
        stopped = await client.next("stopped")
        assert stopped["reason"] == "fault"
        assert stopped["hint"]


async def test_a_soft_limit_ends_a_jog_within_it() -> None:
    axes = [{"name": "x", "soft_limits": [-1000, 60_000]}, {"name": "y"}]
    configuration = Configuration.model_validate({"nodes": [{"id": 1, "name": "stage", "axes": axes}]})
    async with running(configuration) as bench:
        await bench.until_ready()
        async with jogging(bench) as client:
            await client.hold_for(2.0)
            assert (await client.next("stopped"))["reason"] == "limit"
            assert 59_980 <= truly(bench).place <= 60_000
            client.say("release")
            client.hold()
            assert (await client.next("problem"))["problem"]["code"] == "bad_value"


async def test_a_shutdown_stops_and_says_so(bench: Bench) -> None:
    async with jogging(bench) as client:
        bench.service.begin_shutdown()
        await until_rest(bench)
        assert await client.until_closed() == (1012, "shutting_down")
    async with JogClient(bench.app) as late:
        assert (await late.next("problem"))["problem"]["code"] == "shutting_down"
        assert (await late.until_closed())[0] == 4503


async def test_an_unknown_axis_is_told_and_closed(bench: Bench) -> None:
    async with JogClient(bench.app, "w") as client:
        assert (await client.next("problem"))["problem"]["code"] == "unknown_axis"
        assert await client.until_closed() == (4404, "unknown_axis")


async def test_what_is_no_message_is_told_and_holds_nothing(bench: Bench) -> None:
    await bench.enable()
    bad = [
        "",
        "x",
        "[]",
        '{"kind": "fly"}',
        '{"kind": "hold"}',
        '{"kind": "release", "more": 1}',
        "\0",
        "9" * 400,
    ]
    async with JogClient(bench.app) as client:
        await client.next("hello")
        for text in (*bad, None):
            client.say_raw(text)
            problem = (await client.next("problem"))["problem"]
            assert (problem["status"], problem["code"]) == (422, "bad_request"), text
        client.hold(velocity=1e300)
        assert (await client.next("problem"))["problem"]["code"] == "bad_value"
        assert not truly(bench).moving


async def test_a_bad_hold_ends_the_press(bench: Bench) -> None:
    async with jogging(bench) as client:
        client.hold(unit="furlongs")
        bad = now()
        assert await until_rest(bench) - bad <= RAMP + LATE


async def test_a_flood_of_messages_is_ended(bench: Bench) -> None:
    async with jogging(bench) as client:
        for _ in range(int(PER_SECOND) + 5):
            client.hold()
        assert await client.until_closed() == (1008, "too_many_requests")
        await until_rest(bench)


async def test_statuses_are_the_latest_and_bounded(bench: Bench) -> None:
    async with jogging(bench) as client:
        before, begun = client.statuses, now()
        for _ in range(50):
            client.hold()
            await asyncio.sleep(0.02)
        assert 20 <= client.statuses - before <= (now() - begun) / STATUS + 1
        client.say("ping", echo=client.stamp, echo_age_ms=(now() - client.stamped_at) * 1000, sent=12)
        assert (await client.next("pong"))["sent"] == 12


async def test_role_ticket_and_origin_are_checked_before_it_is_accepted(tmp_path: Path) -> None:
    secrets = {role: add_token(tmp_path / "tokens", f"may-{role.word}", role) for role in Role}
    audit = tmp_path / "audit.jsonl"
    configuration = Configuration.model_validate(
        {"server": {"token_file": tmp_path / "tokens"}, "audit": {"file": audit}}
    )
    async with running(configuration) as bench:
        await bench.until_ready()
        move = {"Authorization": f"Bearer {secrets[Role.MOVE]}"}
        for headers in ({}, {"authorization": f"Bearer {secrets[Role.STOP]}"}):
            async with JogClient(bench.app, **headers) as client:
                assert (await client.until_closed())[0] == 1008
        async with JogClient(bench.app, origin="http://evil.example") as client:
            assert await client.until_closed() == (1008, "forbidden_origin")
        await bench.post("/nodes/1/axes/0/enable", headers=move)
        ticket = (await bench.post("/tickets", headers=move)).json()["ticket"]
        async with JogClient(bench.app, query=f"ticket={ticket}") as client:
            await client.next("hello")
            await client.hold_for(0.4)
            client.say("release")
            stopped = await client.next("stopped")
            operation = (await bench.client.get(stopped["operation"], headers=move)).json()
            assert operation["asked_by"]["name"] == "may-move"
        async with JogClient(bench.app, query=f"ticket={ticket}") as client:
            assert (await client.until_closed())[0] == 1008
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    begun, ended = (line for line in lines if line["method"] == "WEBSOCKET")
    assert (begun["who"], begun["body"]["velocity"]) == ("may-move", SPEED)
    assert begun["operation"] == ended["operation"] == operation["id"]
    assert ended["stopped"] == "released"


async def test_an_axis_of_somebody_else_s_lease_is_not_jogged(bench: Bench) -> None:
    await bench.enable()
    lease = (await bench.post("/leases", {"node": 1, "owner": "anna", "ttl_s": 3}, headers={})).json()
    async with JogClient(bench.app) as stranger:
        await stranger.next("hello")
        stranger.hold(SPEED)
        assert (await stranger.next("problem"))["problem"]["code"] == "leased"
    assert await operations(bench) == []
    async with JogClient(bench.app, lease=lease["token"]) as holder:
        await holder.next("hello")
        await holder.hold_for(1.0)
        assert truly(bench).velocity == SPEED
        await holder.hold_for(2.5)
        stopped = await holder.next("stopped")
        assert stopped["reason"] == "lease"
        assert (await holder.next("problem"))["problem"]["code"] == "lease_lost"
    await until_rest(bench)
    [operation] = await operations(bench)
    assert operation["state"] == "cancelled"
    assert "The lease of anna expired" in operation["reason"]


@pytest.mark.parametrize("end", ["release", "take-over"])
async def test_a_jog_ends_with_the_lease_under_which_it_is_held(bench: Bench, end: str) -> None:
    await bench.enable()
    lease = (await bench.post("/leases", {"node": 1, "ttl_s": 60}, headers={})).json()
    async with JogClient(bench.app) as client:
        await client.next("hello")
        client.say("lease", token="none such")
        assert (await client.next("problem"))["problem"]["code"] == "lease_lost"
        client.say("lease", token=lease["token"])
        await client.hold_for(1.0)
        assert truly(bench).velocity == SPEED
        lost = now()
        if end == "release":
            path, body, headers = lease["links"]["release"][7:], None, {"Lease": lease["token"]}
        else:
            path, body, headers = "/leases", {"node": 1, "force": True}, {}
        ending = asyncio.create_task(bench.post(path, body, headers=headers))
        assert await until_rest(bench) - lost <= RAMP + LATE
        assert (await ending).is_success
        stopped = await client.next("stopped")
        assert stopped["reason"] == "lease"
        assert (await bench.client.get(stopped["operation"])).json()["state"] == "cancelled"
        for again in range(2):
            await client.hold_for(0.4)
            assert (await client.next("problem"))["problem"]["code"] == "lease_lost", again
            client.say("release")
        assert not truly(bench).moving
        assert len(await operations(bench)) == 1


async def test_a_jog_without_a_lease_ends_when_somebody_takes_one(bench: Bench) -> None:
    async with jogging(bench) as client:
        assert (await bench.post("/leases", {"node": 1}, headers={})).status_code == 201
        client.hold()
        held = now()
        assert await until_rest(bench) - held <= RAMP + LATE
        assert (await client.next("problem"))["problem"]["code"] == "leased"
        assert (await client.next("stopped"))["reason"] == "lease"


@asynccontextmanager
async def beginning(bench: Bench, **headers: str) -> AsyncIterator[JogClient]:
    """An enabled axis and a client whose first hold is just being written down; it is written at the end."""
    store, asked, on = bench.service.store, asyncio.Event(), asyncio.Event()
    commit = store.commit

    async def slowly(*statements: Any) -> bool:
        asked.set()
        await on.wait()
        return await commit(*statements)

    async with JogClient(bench.app, **headers) as client:
        await client.next("hello")
        store.commit = slowly
        client.hold()
        await asyncio.wait_for(asked.wait(), 1)
        store.commit = commit
        yield client
        on.set()
        await asyncio.sleep(SILENCE / 2)
        assert not truly(bench).moving
        await asyncio.sleep(SILENCE)
    assert truly(bench).place == 0
    assert await operations(bench) == [], "none is left behind"


async def test_a_client_that_is_gone_before_its_jog_begins_turns_nothing(bench: Bench) -> None:
    await bench.enable()
    async with beginning(bench) as client:
        client.vanish()
        await asyncio.sleep(0.01)


@pytest.mark.parametrize("end", ["release", "take-over"])
async def test_a_jog_whose_lease_ends_before_it_begins_turns_nothing(bench: Bench, end: str) -> None:
    await bench.enable()
    leases, axis = bench.service.leases, bench.service.network.node(1).axis(0)
    lease = await leases.take([axis], ttl_s=60, owner="anna", holder="anna")
    async with beginning(bench, lease=lease.token) as client:
        if end == "release":
            await leases.release(lease.id, lease.token)
        else:
            await leases.take([axis], ttl_s=60, owner="bert", holder="bert", force=True)
    assert (await client.next("problem"))["problem"]["code"] == "lease_lost"
