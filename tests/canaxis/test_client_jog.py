"""A jog of the client on a service with a real socket."""

from __future__ import annotations

import asyncio
import contextlib
import subprocess
import sys
import time
from collections.abc import Callable

import pytest
from test_client_service import url  # noqa: F401 - a fixture
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.http.connections import MAX_MESSAGE
from canaxis import (
    AsyncClient,
    AsyncJog,
    Client,
    Forbidden,
    Leased,
    NotReady,
    OperationCancelled,
    ServiceUnreachable,
    UnknownAxis,
)

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]


def until(condition: Callable[[], bool], within: float = 20.0) -> None:
    deadline = time.monotonic() + within
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


async def seen(condition: Callable[[], bool]) -> None:
    await asyncio.to_thread(until, condition)


def test_hold_release_and_what_ends_a_press(url: str) -> None:  # noqa: F811
    with Client(url) as client:
        axis = client.node("stage").axis("x")
        axis.disable()
        with axis.jog() as jog:
            jog.hold(1, "mm")
            until(lambda: jog.state == "used_up")
            with pytest.raises(NotReady):
                jog.release()
            axis.enable()
            jog.hold(1, "mm")
            assert (ended := jog.release()) is not None
            assert ended.reason == "released", "however short it was"
            jog.hold(2, "mm", acceleration=20)
            until(lambda: jog.velocity is not None and jog.velocity.value == pytest.approx(2, rel=0.01))
            assert jog.round_trip_ms is not None
            assert jog.state == "turning"
            ended = jog.release()
            assert ended is not None
            assert ended.reason == "released"
            assert not axis.status().moving
            jog.hold(-2, "mm")
            until(lambda: jog.velocity is not None and jog.velocity.value < 0)
            axis.stop()
            until(lambda: jog.stopped is not None)
            with pytest.raises(OperationCancelled):
                jog.hold(-2, "mm")
            ended = jog.release()
            assert ended is not None
            assert ended.reason == "stop"
            jog.hold(-2, "mm")
        assert client.operations(limit=1)[0].status.kind == "jog"
        assert not axis.status().moving, "leaving lets go and waits"
        axis.disable()


def test_a_jog_under_a_lease_ends_with_it(url: str) -> None:  # noqa: F811
    x = ("stage", "x")
    with Client(url) as client, client.lease(x, ttl=30) as lease:
        axis = lease.node("stage").axis("x")
        axis.enable()
        with client.node("stage").axis("x").jog() as stranger:
            stranger.hold(1, "mm")
            until(lambda: stranger.state == "used_up")
            with pytest.raises(Leased):
                stranger.release()
        with axis.jog() as jog:
            jog.hold(1, "mm")
            until(lambda: jog.state == "turning")
            with client.lease(x, force=True) as taken:
                until(lambda: jog.stopped is not None)
                assert jog.stopped is not None
                assert jog.stopped.reason == "lease"
                with pytest.raises(OperationCancelled):
                    jog.hold(1, "mm")
                assert not taken.node("stage").axis("x").disable().moving


async def test_hold_release_and_what_ends_a_press_in_an_event_loop(url: str) -> None:  # noqa: F811
    async with AsyncClient(url) as client:
        axis = client.node("stage").axis("y")
        async with axis.jog() as jog:
            await jog.hold(20_000, "steps")
            await seen(lambda: jog.state == "used_up")
            with pytest.raises(NotReady):
                await jog.release()
            await axis.enable()
            await jog.hold(20_000, "steps")
            await seen(lambda: jog.velocity is not None and jog.velocity.steps == 20_000)
            assert jog.round_trip_ms is not None
            ended = await jog.release()
            assert ended is not None
            assert ended.reason == "released"
            assert not (await axis.status()).moving
            await jog.hold(-20_000, "steps")
            await seen(lambda: jog.velocity is not None and jog.velocity.steps < 0)
            await axis.stop()
            await seen(lambda: jog.stopped is not None)
            with pytest.raises(OperationCancelled):
                await jog.hold(-20_000, "steps")
            ended = await jog.release()
            assert ended is not None
            assert ended.reason == "stop"
            await jog.hold(-20_000, "steps")
        assert not (await axis.status()).moving, "leaving lets go and waits"
        with pytest.raises(ServiceUnreachable):
            await jog.hold(20_000, "steps")
        await axis.disable()


async def test_a_task_that_is_cancelled_while_it_holds_lets_go(url: str) -> None:  # noqa: F811
    jogs: list[AsyncJog] = []

    async def hold_for_ever(client: AsyncClient) -> None:
        async with client.node("stage").axis("y").jog() as jog:
            await jog.hold(20_000, "steps")
            jogs.append(jog)
            await asyncio.Event().wait()

    async with AsyncClient(url) as client:
        axis = client.node("stage").axis("y")
        await axis.enable()
        holding = asyncio.create_task(hold_for_ever(client))
        await seen(lambda: bool(jogs) and jogs[0].state == "turning")
        holding.cancel()
        await asyncio.wait({holding})
        assert holding.cancelled()
        ended = jogs[0].stopped
        assert ended is not None
        assert ended.reason == "released", "not by the silence of a connection that was left open"
        assert not (await axis.status()).moving
        await axis.disable()


def test_no_connection_is_an_error_with_its_reason(url: str) -> None:  # noqa: F811
    with Client(url) as client, pytest.raises(UnknownAxis) as unknown:
        client.node("stage").axis("w").jog()
    assert unknown.value.status == 404
    with Client("http://127.0.0.1:9") as nobody, pytest.raises(ServiceUnreachable):
        nobody.node(1).axis(0).jog()
    with (
        Client(url.replace("127.0.0.1", "127.0.0.1.")) as misled,
        pytest.raises((Forbidden, ServiceUnreachable)),
    ):
        misled.node(1).axis(0).jog()


def test_the_client_is_imported_without_websockets() -> None:
    code = "import sys, canaxis; sys.exit('websockets' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_message_that_is_too_large_is_not_read(url: str) -> None:  # noqa: F811
    place = f"{url.replace('http', 'ws', 1)}/api/v1/nodes/stage/axes/x/jog"
    with connect(place) as socket:
        socket.recv(timeout=10)
        socket.send("x" * (MAX_MESSAGE + 1))
        with contextlib.suppress(ConnectionClosed):
            for _ in range(1000):
                socket.recv(timeout=10)
        assert socket.close_code == 1009
