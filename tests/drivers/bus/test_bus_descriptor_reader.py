"""When a watched descriptor is read: what comes alone or is awaited at once, a stream in batches."""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence

import pytest

from drivers.bus import reader as reading
from drivers.bus.frame import Frame
from drivers.bus.reader import BATCH, HURRY, REST, DescriptorReader, Lost

pytestmark = pytest.mark.looptime


class Wire:
    """A source, and a loop that tells of it only while it is watched, as a real one does."""

    def __init__(self, descriptor: int, monkeypatch: pytest.MonkeyPatch) -> None:
        self.waiting: deque[Frame] = deque()
        self.broken = False
        self.batches: list[int] = []
        self.arrivals: list[float] = []
        self.lost: list[str] = []
        self._loop = asyncio.get_running_loop()
        self._callback = None
        monkeypatch.setattr(self._loop, "add_reader", self._add)
        monkeypatch.setattr(self._loop, "remove_reader", self._remove)
        self.reader = DescriptorReader(self, descriptor, self._on_frames, self.lost.append)

    @property
    def watched(self) -> bool:
        return self._callback is not None

    def bring(self, count: int = 1) -> None:
        self.waiting.extend(Frame(0x181) for _ in range(count))
        if self._callback is not None:
            self._callback()

    async def stream(self, count: int, gap: float) -> None:
        for _ in range(count):
            self.bring()
            await asyncio.sleep(gap)

    def receive(self, timeout: float) -> Frame | None:
        raise AssertionError("a watched source is drained")

    def drain(self, into: list[Frame], limit: int) -> None:
        while self.waiting and len(into) < limit:
            into.append(self.waiting.popleft())
        if self.broken and not self.waiting:
            raise Lost("gone")

    def _on_frames(self, batch: Sequence[Frame]) -> None:
        self.batches.append(len(batch))
        self.arrivals.append(self._loop.time())

    def _add(self, _descriptor: int, callback: Callable[[], None]) -> None:
        self._callback = callback

    def _remove(self, _descriptor: int) -> None:
        self._callback = None


@pytest.fixture
async def wire(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Wire]:
    descriptors = os.pipe()
    wire = Wire(descriptors[0], monkeypatch)
    yield wire
    wire.reader.stop()
    for descriptor in descriptors:
        os.close(descriptor)


async def test_what_comes_alone_is_handed_over_at_once(wire: Wire) -> None:
    for _ in range(5):
        wire.bring()
        assert not wire.waiting
        await asyncio.sleep(0.01)
    assert wire.batches == [1] * 5


async def test_a_stream_is_read_several_frames_at_a_time_and_never_late(wire: Wire) -> None:
    loop = asyncio.get_running_loop()
    came: list[float] = []
    for _ in range(9000):
        came.append(loop.time())
        wire.bring()
        await asyncio.sleep(1 / 9000)
    await asyncio.sleep(0.01)
    assert sum(wire.batches) == 9000
    assert len(wire.batches) < 9000 / 9
    handed = [at for at, count in zip(wire.arrivals, wire.batches, strict=True) for _ in range(count)]
    assert max(late - at for at, late in zip(came, handed, strict=True)) <= REST[1] + 1e-6


async def test_after_a_stream_the_descriptor_is_watched_again(wire: Wire) -> None:
    await wire.stream(100, 0.0002)
    assert not wire.watched
    await asyncio.sleep(2 * REST[1])
    assert wire.watched
    wire.bring()
    assert not wire.waiting


async def test_an_answer_within_a_stream_never_waits(wire: Wire) -> None:
    await wire.stream(100, 0.0002)
    assert not wire.watched
    wire.reader.expect_answer()
    for _ in range(int(HURRY / 0.0002) - 1):
        wire.bring()
        assert not wire.waiting
        await asyncio.sleep(0.0002)
    await wire.stream(10, 0.0002)
    assert not wire.watched, "it rests again"


async def test_a_flood_leaves_the_loop_its_turn(wire: Wire) -> None:
    turns: list[int] = []
    wire.waiting.extend(Frame(0x181) for _ in range(3 * BATCH))
    wire.bring()
    while sum(wire.batches) <= 3 * BATCH:
        turns.append(sum(wire.batches))
        await asyncio.sleep(0)
    assert turns[:3] == [BATCH, 2 * BATCH, 3 * BATCH]


async def test_frames_that_came_before_the_loss_are_handed_over_before_it_is_told(wire: Wire) -> None:
    wire.broken = True
    wire.bring(3)
    assert wire.batches == [3]
    assert wire.lost == ["gone"]


async def test_a_stopped_reader_looks_no_more(wire: Wire) -> None:
    await wire.stream(100, 0.0002)
    wire.reader.stop()
    heard = sum(wire.batches)
    wire.bring()
    await asyncio.sleep(1)
    assert sum(wire.batches) == heard
    assert not wire.watched


async def test_no_rest_is_longer_than_the_kernel_can_hold_frames_for(wire: Wire) -> None:
    full_bus_of_empty_frames = 21_277
    assert reading.REST[1] * full_bus_of_empty_frames < 250, "what a default receive buffer holds"


async def test_an_answer_is_taken_without_asking_for_a_second_frame(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the descriptor shows what is left, and only in the first look after something was sent."""
    limits: list[int] = []
    drain = wire.drain
    monkeypatch.setattr(wire, "drain", lambda into, limit: (limits.append(limit), drain(into, limit)))
    wire.reader.stop()
    wire.reader = DescriptorReader(wire, 0, wire._on_frames, wire.lost.append, shows_all=True)
    wire.reader.expect_answer()
    wire.bring(3)
    assert wire.batches == [1]
    assert wire.watched, "so that the loop calls again for the other two"
    wire.bring(0)
    assert wire.batches == [1, 2]
    assert limits == [1, BATCH]
