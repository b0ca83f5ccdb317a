"""Our heartbeat's deadlines, and watchdogs."""

from __future__ import annotations

import asyncio
import time

import pytest

from drivers.master.seen.watch import HeartbeatProducer, Watchdog


@pytest.mark.looptime
async def test_the_heartbeat_keeps_absolute_deadlines() -> None:
    loop = asyncio.get_running_loop()
    beats: list[float] = []
    producer = HeartbeatProducer(0.15, lambda: beats.append(loop.time()), lambda n: None)
    start = loop.time()
    producer.start()
    await asyncio.sleep(1.51)
    producer.stop()
    assert [round(beat - start, 3) for beat in beats] == [round(0.15 * n, 3) for n in range(11)]
    await asyncio.sleep(1)
    assert len(beats) == 11


async def test_a_blocked_loop_falls_silent_and_does_not_catch_up_in_a_burst() -> None:
    beats: list[float] = []
    missed: list[int] = []
    producer = HeartbeatProducer(0.02, lambda: beats.append(time.monotonic()), missed.append)
    producer.start()
    await asyncio.sleep(0)
    time.sleep(0.11)  # noqa: ASYNC251 - a hung event loop is what this is about
    while len(beats) < 2:  # noqa: ASYNC110 - a slow machine may need a moment
        await asyncio.sleep(0)
    for _ in range(5):
        await asyncio.sleep(0)
    producer.stop()
    assert len(beats) == 2
    assert sum(missed) >= 4


@pytest.mark.looptime
async def test_a_watchdog_speaks_once_and_is_armed_anew_by_feeding() -> None:
    loop = asyncio.get_running_loop()
    silences: list[float] = []
    dog = Watchdog(0.3, 0.02, lambda: silences.append(round(loop.time() - start, 3)))
    start = loop.time()
    await asyncio.sleep(1)
    assert silences == []
    start = loop.time()
    for _ in range(5):
        dog.feed(loop.time())
        await asyncio.sleep(0.2)
    await asyncio.sleep(2)
    assert silences == [pytest.approx(0.8 + 0.3 + 0.02, abs=0.005)]
    dog.feed(loop.time())
    await asyncio.sleep(1)
    assert len(silences) == 2


@pytest.mark.looptime
async def test_what_comes_in_the_grace_saves_the_day() -> None:
    loop = asyncio.get_running_loop()
    silences: list[float] = []
    dog = Watchdog(0.3, 0.05, lambda: silences.append(loop.time()))
    dog.feed(loop.time())
    await asyncio.sleep(0.32)
    dog.feed(loop.time())
    await asyncio.sleep(0.2)
    assert silences == []
    dog.stop()
