"""The service's own mishaps that need no second process: clocks that jump, an orderly end, a new start."""

from __future__ import annotations

import asyncio
import datetime as real
import itertools
import sys
import time

import pytest
from api_bench import Bench, running
from fault_kit import (
    FAR,
    ended,
    moving,
    reasons,
    refusal,
    sent_to,
    truly_moving,
    truly_state,
)

from app.main import create_app
from drivers.cia402.power import PowerState

pytestmark = pytest.mark.looptime


class WallClock:
    """What the machine believes the time of day to be; a hand on it, from one year to another."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.offset = real.timedelta()
        clock = self

        class Jumping(real.datetime):
            @classmethod
            def now(cls, tz: real.tzinfo | None = None) -> real.datetime:
                return real.datetime.now(tz) + clock.offset

        for name, module in tuple(sys.modules.items()):
            if name.startswith(("app", "drivers")) and vars(module).get("datetime") is real.datetime:
                monkeypatch.setattr(module, "datetime", Jumping)
        of_day = time.time
        monkeypatch.setattr(time, "time", lambda: of_day() + clock.offset.total_seconds())


async def test_a_wall_clock_that_jumps_changes_time_stamps_and_nothing_else(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = WallClock(monkeypatch)
    beats: list[float] = []
    loop = asyncio.get_running_loop()
    bench.wire.tap(lambda _, frame: beats.append(loop.time()) if frame.cob_id == 0x77F else None)
    operation = await moving(bench)
    year = real.datetime.fromisoformat(operation["created"]).year
    for days in (-3650, 3650, 0):
        clock.offset = real.timedelta(days=days)
        await asyncio.sleep(2)
        assert (await bench.get(operation["links"]["self"].removeprefix("/api/v1"))).json()[
            "state"
        ] == "running"
        assert (await bench.axis())["stale"] is False
        assert 0 <= (await bench.get("/nodes/1")).json()["heartbeat_age_s"] < 1
        assert await reasons(bench) == []
    assert max(later - earlier for earlier, later in itertools.pairwise(beats)) < 0.15
    clock.offset = real.timedelta(days=-3650)
    stopped = (await bench.post(f"/operations/{operation['id']}/cancel")).json()
    assert stopped["state"] == "cancelled"
    assert abs(real.datetime.fromisoformat(stopped["ended"]).year - (year - 10)) <= 1
    assert (await bench.move(100, relative=True, wait=30)).json()["state"] == "succeeded"


async def test_with_its_loop_our_heartbeat_stops_and_the_module_stops_the_motors(bench: Bench) -> None:
    """A stalled loop is a heartbeat that isn't sent; a loop that truly stalls is in tests/process."""
    operation = await moving(bench)
    bench.wire.faults.drop(lambda frame: frame.cob_id == 0x77F)
    failed = await ended(bench, operation)
    assert failed["state"] == "failed"
    await bench.until(lambda: truly_state(bench) == PowerState.FAULT.value)
    await bench.until(lambda: not truly_moving(bench))
    listed = (await bench.get("/nodes/1/emergencies")).json()["emergencies"]
    assert "0x8130" in [each["code"] for each in listed]


async def test_at_an_orderly_end_the_axes_stand_before_the_heartbeat_ends() -> None:
    async with running() as bench:
        await bench.until_ready()
        await bench.enable("0", "1")
        await bench.move(FAR)
        await bench.move(-FAR, axis="1")
        await bench.until_moving(0)
        await bench.until_moving(1)
        stood: list[bool] = []
        bench.wire.tap(
            lambda _, frame: stood.append(not truly_moving(bench)) if frame.cob_id == 0x77F else None
        )
        bench.service.begin_shutdown()
        assert refusal(await bench.move(1)) == (503, "shutting_down")
        assert "shutting down" in (await reasons(bench))[0]
        await bench.service.close()
        assert stood[-1], "our last heartbeat came after the last motor stood"
        assert not truly_moving(bench, 1)
        assert {truly_state(bench, axis) for axis in range(3)} == {PowerState.SWITCH_ON_DISABLED.value}


async def test_an_orderly_end_is_bounded_where_an_axis_can_t_be_stopped() -> None:
    async with running() as bench:
        await bench.until_ready()
        await moving(bench)
        bench.wire.faults.drop(lambda frame: frame.cob_id != 0x77F)
        beats = sent_to(bench, 0x77F)
        loop = asyncio.get_running_loop()
        begun = loop.time()
        await bench.service.close()
        assert loop.time() - begun < bench.service.network.timing.shutdown + 1
        count = len(beats)
        await asyncio.sleep(2)
        assert len(beats) == count, "our heartbeat has ended, so the module stops its motor"
        assert not truly_moving(bench)


async def test_a_service_that_is_started_while_axes_move_adopts_them() -> None:
    """Nothing is reset; the drive is read, its stop works, and it waits for somebody to claim it."""
    async with running() as bench:
        await bench.until_ready()
        await bench.enable()
        body = {"velocity": 30_000, "unit": "steps"}
        assert (await bench.post("/nodes/1/axes/0/velocity?wait=30", body)).json()["state"] == "succeeded"
        first = bench.service.network
        for node in first.nodes.values():
            await node.close()  # the first service is gone in mid-sentence
        first._heartbeat.stop()
        assert first._unsubscribe is not None
        first._unsubscribe()
        first._unsubscribe = None
        asked = sent_to(bench, 0x601)
        commands = sent_to(bench, 0x000)
        bus = bench.wire.port("second service")
        app = create_app(bench.configuration, bus)
        async with app.router.lifespan_context(app) as state:
            assert state is not None
            second = state["network"]
            events_of = second.events.subscribe()
            node = second.node(1)
            while node.status().state != "operational":
                await asyncio.wait_for(events_of.get(), 10)
            events_of.close()
            read = {int.from_bytes(frame.data[1:3], "little") for frame in asked if frame.data[0] == 0x40}
            assert {0x6041, 0x6061, 0x6064} <= read
            assert not {frame.data[0] for frame in commands} & {0x81, 0x82}, "nothing is reset"
            assert node.axis(0).adopted
            assert node.axis(0).status.moving
            assert truly_moving(bench)
            assert [each.code for each in node.axis(0).readiness("move")] == ["turning", "adopted"]
            await node.axis(0).stop()
            assert not truly_moving(bench)
            await node.axis(0).enable()
            assert not node.axis(0).adopted
