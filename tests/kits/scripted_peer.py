"""A byte-wise SDO peer: it keeps what it is asked, and answers only what a test tells it to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.bus.frame import Frame
from drivers.errors import BusDown
from drivers.master.ground.timing import Timing
from drivers.master.sdo.client import SdoClient

NODE = 5


class ScriptedPeer:
    """The other side of one `SdoClient`."""

    def __init__(self, timing: Timing | None = None, remedy: Callable[[int], str] | None = None) -> None:
        self.asked: list[bytes] = []
        self.down = False
        self.client = SdoClient(NODE, self._take, timing, remedy=remedy)

    def _take(self, frame: Frame) -> None:
        if self.down:
            raise BusDown("the wire is gone")
        assert frame.cob_id == 0x600 + NODE
        self.asked.append(frame.data)

    def answer(self, text: str) -> None:
        """Send eight (or other) bytes, in hex."""
        self.client.on_frame(Frame(0x580 + NODE, bytes.fromhex(text)))

    async def turn(self, count: int = 1) -> list[bytes]:
        """Let the loop run until `count` requests were sent in all; returns them."""
        async with asyncio.timeout(5):
            while len(self.asked) < count:  # noqa: ASYNC110 - nothing tells, and the clock is virtual
                await asyncio.sleep(0.001)
        return self.asked
