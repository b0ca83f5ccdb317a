"""A bus whose wire may go and come back: what waits, what is lost, and when to open it again."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Collection, Sequence
from typing import Protocol

from drivers.bus.base import Beside, BusCounters, BusState, FrameHandler, StateHandler
from drivers.bus.controller import reported_state
from drivers.bus.frame import Frame
from drivers.bus.listeners import Listeners
from drivers.bus.outbox import Outbox
from drivers.bus.reader import DescriptorReader, Lost, Reader, Source, ThreadReader
from drivers.errors import BadValue, BusDown, BusOverflow

FLUSHING = 0.1
"""Seconds that waiting frames get to leave when the bus is closed."""
RETRY = (0.001, 0.01)
"""Seconds between tries to send when the interface is full: the first, doubled up to the longest."""
REOPEN = (0.1, 5.0)
"""Seconds between tries to open a lost wire: the first, doubled up to the longest."""


class Link(Source, Protocol):
    """One open interface; when it is lost, the bus makes another."""

    @property
    def is_off(self) -> bool:
        """Whether the controller is known to be bus-off from the start."""
        ...

    @property
    def overrun(self) -> int:
        """Frames that the system dropped because we read too slowly."""
        ...

    @property
    def shows_all(self) -> bool:
        """Whether the descriptor is readable whenever a frame waits; False if the link may hold some."""
        ...

    def descriptor(self) -> int | None:
        """What the event loop can watch; None if a thread must read."""
        ...

    def write(self, frame: Frame) -> bool:
        """Hand a frame over without blocking; False if the interface takes none now. Raises `Lost`."""
        ...

    async def close(self) -> None:
        """Close it, within a bounded time, whatever its state. Never raises."""
        ...


class SupervisedBus:
    """A `Bus` over links that `connect` makes, one at a time; it raises `BusDown` when it can't."""

    def __init__(self, name: str, connect: Callable[[], Awaitable[Link]]) -> None:
        self._name = name
        self._connect = connect
        self._state = BusState.CLOSED
        self._can_send = False
        """`_state.can_send`, looked up once rather than for every frame."""
        self._listeners = Listeners()
        self._outbox = Outbox()
        self._link: Link | None = None
        self._reader: Reader | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._supervisor: asyncio.Task[None] | None = None
        self._received = 0
        self._sent = 0
        self._overrun = 0
        self._reopened = 0

    @property
    def name(self) -> str:
        """What a person calls this bus, e.g. ``socketcan:can0``."""
        return self._name

    @property
    def state(self) -> BusState:
        """The state now."""
        return self._state

    @property
    def counters(self) -> BusCounters:
        """What this bus carried so far."""
        overrun = self._overrun
        if self._reader is not None:
            overrun += self._reader.overrun
        if self._link is not None:
            overrun += self._link.overrun
        return BusCounters(self._received, self._sent, overrun + self._outbox.dropped, self._reopened)

    @property
    def beside(self) -> Beside | None:
        """See `Bus.beside`: unless a subclass knows better, a link is ours alone."""
        return None

    def subscribe(self, on_frames: FrameHandler, on_state: StateHandler | None = None) -> Callable[[], None]:
        """See `Bus.subscribe`."""
        return self._listeners.subscribe(on_frames, on_state)

    # --- open, close, lose, reopen

    async def open(self) -> None:
        """See `Bus.open`. A bus that is down already is on its way up: returns at once."""
        if self._state is not BusState.CLOSED:
            return
        link = await self._connect()
        if self._state is BusState.CLOSED:
            self._begin(link)
        else:  # someone else opened it meanwhile
            await link.close()

    async def close(self) -> None:
        """See `Bus.close`."""
        await self._end_supervision()
        loop = asyncio.get_running_loop()
        end = loop.time() + FLUSHING
        while len(self._outbox) and self._state.can_send and loop.time() < end:
            await asyncio.sleep(RETRY[0])
            self._drain()
        link = self._release()
        self._change(BusState.CLOSED, f"{self.name} is closed")
        if link is not None:
            await link.close()
        await self._end_supervision()  # begun anew if the wire was lost while we flushed

    async def _end_supervision(self) -> None:
        if self._supervisor is not None:
            self._supervisor.cancel()
            await asyncio.wait([self._supervisor])
            self._supervisor = None

    def _begin(self, link: Link) -> None:
        """Use an open link."""
        self._link = link
        self._reader = _reader(link, self._take, self._lose)
        if link.is_off:
            self._change(BusState.BUS_OFF, f"{self.name}: the CAN controller was bus-off already")
        else:
            self._change(BusState.ACTIVE, f"{self.name} is open")

    def _release(self) -> Link | None:
        """Stop using the link; the caller closes it."""
        if self._reader is not None:
            self._reader.stop()
            self._overrun += self._reader.overrun
            self._reader = None
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        self._outbox.clear()
        link, self._link = self._link, None
        if link is not None:
            self._overrun += link.overrun
        return link

    def _lose(self, reason: str) -> None:
        """The wire is gone: say so, and try from now on to get it back."""
        link = self._release()
        if link is not None:
            loop = asyncio.get_running_loop()
            self._supervisor = loop.create_task(self._reopen(link), name=f"reopen {self.name}")
            self._change(BusState.DOWN, f"{self.name} is down: {reason}")

    async def _reopen(self, lost: Link) -> None:
        # The old socket is never used again: after a replug it stays deaf for good.
        await lost.close()
        pause, longest = REOPEN
        while True:
            await asyncio.sleep(pause)
            try:
                link = await self._connect()
            except BusDown:
                pause = min(2 * pause, longest)
            else:
                break
        self._reopened += 1
        self._begin(link)

    def _change(self, state: BusState, reason: str) -> None:
        if state is not self._state:
            self._state = state
            self._can_send = state.can_send
            self._listeners.state(state, reason)

    # --- receive

    def _take(self, batch: Sequence[Frame]) -> None:
        """Frames have arrived. What the controller says of itself counts before what the subscribers do."""
        self._received += len(batch)
        for frame in batch:
            if frame.error and (report := reported_state(frame)) is not None:
                state, reason = report
                if state is BusState.BUS_OFF:
                    self._outbox.clear()
                self._change(state, f"{self.name}: {reason}")
        self._listeners.frames(batch)

    # --- send

    def withdraw(self, cob_ids: Collection[int]) -> int:
        """See `Bus.withdraw`."""
        return self._outbox.withdraw(cob_ids)

    def send(self, frame: Frame, *, urgent: bool = False, answered: bool = True) -> None:
        """See `Bus.send`. Raises `BadValue` for what no controller can send."""
        link = self._link
        if link is None or not self._can_send:
            raise BusDown(f"{self.name} is {self._state.value.replace('_', '-')}: the frame was not sent")
        if not frame.is_sendable:
            raise BadValue(f"{frame} is no frame that a controller can send")
        if answered and self._reader is not None:
            self._reader.expect_answer()
        overtakes = not self._outbox or (urgent and not self._outbox.holds_urgent)
        if overtakes and self._write(link, frame):
            return
        if self._link is None:
            raise BusDown(f"{self.name} went down as the frame was to be sent")
        if not self._outbox.put(frame, asyncio.get_running_loop().time(), urgent=urgent):
            raise BusOverflow(
                f"the transmit queue of {self.name} is full: nobody takes our frames off the wire"
            )
        self._retry_in(RETRY[0])

    def _write(self, link: Link, frame: Frame) -> bool:
        """Hand one frame to the interface; False if it takes none now, or is gone."""
        try:
            written = link.write(frame)
        except Lost as lost:
            self._lose(str(lost))
            return False
        self._sent += written
        return written

    def _retry_in(self, pause: float) -> None:
        if self._retry is None:
            self._retry = asyncio.get_running_loop().call_later(pause, self._try_again, pause)

    def _try_again(self, pause: float) -> None:
        self._retry = None
        pause = RETRY[0] if self._drain() else min(2 * pause, RETRY[1])
        if self._outbox:
            self._retry_in(pause)

    def _drain(self) -> int:
        """Send what waits, as far as the interface takes it; how many frames left."""
        left = 0
        now = asyncio.get_running_loop().time()
        while self._link is not None and (frame := self._outbox.foremost(now)) is not None:
            if not self._write(self._link, frame):
                break
            self._outbox.pop()
            left += 1
        if left and self._reader is not None:
            self._reader.expect_answer()
        return left


def _reader(
    link: Link, on_frames: Callable[[Sequence[Frame]], None], on_lost: Callable[[str], None]
) -> Reader:
    descriptor = link.descriptor()
    if descriptor is not None:
        with contextlib.suppress(NotImplementedError):  # the loop of Windows watches no descriptors
            return DescriptorReader(link, descriptor, on_frames, on_lost, shows_all=link.shows_all)
    return ThreadReader(link, on_frames, on_lost)
