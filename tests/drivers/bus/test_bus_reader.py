"""Reader threads, and calls that never come back."""

from __future__ import annotations

import asyncio
import queue
import threading

import pytest

from drivers.bus import reader
from drivers.bus.blocking import in_thread
from drivers.bus.frame import Frame
from drivers.bus.reader import Lost, ThreadReader


class Source:
    """Gives what the test puts in; an error is raised."""

    def __init__(self) -> None:
        self.put: queue.Queue[Frame | Lost] = queue.Queue()

    def receive(self, timeout: float) -> Frame | None:
        try:
            item = self.put.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(item, Lost):
            raise item
        return item

    def drain(self, into: list[Frame], limit: int) -> None:
        raise NotImplementedError("a thread waits for one frame after the other")


async def test_a_thread_hands_over_all_frames_before_the_loss() -> None:
    source, heard, lost = Source(), [], asyncio.Event()
    reasons: list[str] = []

    def on_lost(reason: str) -> None:
        reasons.append(reason)
        lost.set()

    for number in range(600):
        source.put.put(Frame(number))
    source.put.put(Lost("gone"))
    ThreadReader(source, heard.append, on_lost)
    await asyncio.wait_for(lost.wait(), 10)
    assert [frame.cob_id for batch in heard for frame in batch] == list(range(600))
    assert max(len(batch) for batch in heard) <= reader.BATCH
    assert reasons == ["gone"]


async def test_a_stalled_loop_costs_bounded_memory_and_the_loss_is_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(reader, "OVERRUN", 100)
    source, heard = Source(), []
    for number in range(150):
        source.put.put(Frame(number))
    thread = ThreadReader(source, heard.append, heard.append)
    while not source.put.empty():  # the loop is busy
        pass
    source.put.put(Frame(0x7FF))
    while not source.put.empty():
        pass
    for _ in range(5):
        await asyncio.sleep(0)
    thread.stop()
    assert sum(len(batch) for batch in heard) + thread.overrun >= 150
    assert len(heard[0]) == 100
    assert thread.overrun >= 50


async def test_a_stopped_thread_hands_over_nothing_more() -> None:
    source, heard = Source(), []
    thread = ThreadReader(source, heard.append, heard.append)
    thread.stop()
    source.put.put(Frame(1))
    thread._thread.join(5)
    await asyncio.sleep(0)
    assert heard == []
    assert not thread._thread.is_alive()


async def test_a_call_in_a_thread_returns_and_raises() -> None:
    assert await in_thread(lambda: 42, abandon=lambda _: None) == 42
    with pytest.raises(ZeroDivisionError):
        await in_thread(lambda: 1 // 0, abandon=lambda _: None)


async def test_the_late_result_of_a_call_given_up_is_disposed_of() -> None:
    go_on, disposed = threading.Event(), threading.Event()

    def slow() -> str:
        go_on.wait(10)
        return "late"

    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.01):
            await in_thread(slow, abandon=lambda result: disposed.set())
    go_on.set()
    assert await asyncio.to_thread(disposed.wait, 10)
