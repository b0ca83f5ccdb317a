"""The memory wire on a real clock, whose timers come up to a millisecond late."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryWire

EACH = 180
"""Frames of two ports, 111 bits each: 40 ms for all; 360 ms, were each to wait for a timer of its own."""


async def test_a_full_bus_carries_what_its_bit_rate_allows_though_timers_are_late() -> None:
    wire = MemoryWire(bit_rate=1_000_000)
    one, two, three = ports = [wire.port(name) for name in ("one", "two", "three")]
    for port in ports:
        await port.open()
    heard: list[Frame] = []
    complete = asyncio.Event()

    def take(batch: Sequence[Frame]) -> None:
        heard.extend(batch)
        if len(heard) == 2 * EACH:
            complete.set()

    three.subscribe(take)
    try:
        for number in range(EACH):
            for port, cob_id in ((one, 0x181), (two, 0x182)):
                port.send(Frame(cob_id, number.to_bytes(8, "little")))
        async with asyncio.timeout(5):
            await complete.wait()
        assert one.counters.dropped == two.counters.dropped == 0, "none grew stale in its queue"
    finally:
        for port in ports:
            await port.close()
