"""A CAN bus within one process: real arbitration order, an optional bit rate, switches for faults.

It lives on the running loop's clock, so on a virtual clock a whole bus is deterministic and takes no time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Sequence

from drivers.bus.base import BusCounters, BusState, FrameHandler, StateHandler
from drivers.bus.faults import Faults
from drivers.bus.frame import Frame
from drivers.bus.listeners import Listeners
from drivers.bus.outbox import Outbox
from drivers.errors import BadValue, BusDown, BusOverflow

Tap = Callable[[str, Frame], None]
"""Called with the sender's name and the frame, for each frame that crosses the wire."""

QUEUE = 256
"""Frames that may wait in one port, besides the reserve for urgent ones."""
URGENT_RESERVE = 64
"""Urgent frames that may wait in one port."""
CLOSING = 0.1
"""Seconds that `MemoryBus.close` gives waiting frames to go out."""

BUS_OFF_FRAME = Frame(0x040, bytes(8), error=True)
"""What a SocketCAN controller reports as it goes bus-off (error class 40h)."""
RESTARTED_FRAME = Frame(0x100, bytes(8), error=True)
"""What a SocketCAN controller reports as it comes back (error class 100h)."""


def arbitration_key(frame: Frame) -> tuple[int, int, int, int]:
    """Sorts as frames win on the wire (ISO 11898-1): the lower wins.

    The first eleven bits decide first; of two equal ones a data frame beats a remote one, and a standard
    frame an extended one.
    """
    if frame.extended:
        return frame.cob_id >> 18, 1, 1, (frame.cob_id & 0x3FFFF) << 1 | frame.remote
    return frame.cob_id, int(frame.remote), 0, 0


def frame_bits(frame: Frame) -> int:
    """Bits that the frame takes on the wire, the gap of three after it included, without stuff bits."""
    return (67 if frame.extended else 47) + (0 if frame.remote else 8 * len(frame.data))


class MemoryWire:
    """The wire itself: any number of ports, and everything that one sends reaches all the others.

    Each port sends its own frames in the order in which it was given them (urgent ones first), as the queue
    of a network interface does; among the ports the lowest identifier wins. With a `bit_rate` (bit/s) one
    frame after the other takes its time on the wire; without, all that waits goes out at the loop's next
    turn. With a `lead` (seconds) a frame may arrive that much before its end: where other processes are on
    the wire, so that a loop's timers, which are late by up to a millisecond, don't slow every answer down.
    The rate is kept all the same.
    """

    def __init__(self, *, bit_rate: int | None = None, lead: float = 0.0) -> None:
        if bit_rate is not None and bit_rate <= 0:
            raise BadValue(
                f"a bit rate of {bit_rate} bit/s carries nothing", hint="Give 1000000, or none at all."
            )
        self.faults = Faults()
        self._bit_rate = bit_rate
        self._lead = lead
        self._free_at = 0.0
        self._ports: tuple[MemoryBus, ...] = ()
        self._taps: tuple[Tap, ...] = ()
        self._timer: asyncio.Handle | None = None

    @property
    def ports(self) -> tuple[MemoryBus, ...]:
        """All ports, open or not."""
        return self._ports

    def port(self, name: str) -> MemoryBus:
        """A new port, to be opened by who uses it. `name` is for people and for taps."""
        port = MemoryBus(self, name)
        self._ports = (*self._ports, port)
        return port

    def discard(self, port: MemoryBus) -> None:
        """Forget a port for good."""
        self._ports = tuple(other for other in self._ports if other is not port)

    def tap(self, callback: Tap) -> Callable[[], None]:
        """Have `callback` see each frame as it crosses the wire; returns the function that ends it."""

        def entry(sender: str, frame: Frame) -> None:
            callback(sender, frame)

        self._taps = (*self._taps, entry)

        def end() -> None:
            self._taps = tuple(other for other in self._taps if other is not entry)

        return end

    def inject(self, *frames: Frame) -> None:
        """Put frames of no port on the wire, past all queues; error frames may be among them."""
        self._deliver([(None, frame) for frame in frames])

    # --- called by the ports

    def wake(self) -> None:
        """A port has something to send."""
        if self._timer is not None:
            return
        loop = asyncio.get_running_loop()
        # The winner is chosen a turn later, so that all who start in this turn take part in the arbitration.
        start = max(loop.time(), self._free_at)
        self._timer = loop.call_soon(self._flush if self._bit_rate is None else self._carry, start)

    # --- the wire at work

    def _take_winner(self, at: float) -> tuple[MemoryBus, Frame] | None:
        """Take the frame that wins the arbitration at a time from its port; None if none waits."""
        best: tuple[MemoryBus, Frame] | None = None
        best_key: tuple[int, int, int, int] | None = None
        for port in self._ports:
            frame = port.foremost(at)
            if frame is None:
                continue
            key = arbitration_key(frame)
            if best_key is None or key < best_key:
                best, best_key = (port, frame), key
        if best is not None:
            best[0].take()
        return best

    def _flush(self, at: float) -> None:
        """Without a bit rate: everything that waits, in the order in which the wire would carry it."""
        self._timer = None
        crossing: list[tuple[MemoryBus | None, Frame]] = []
        while (winner := self._take_winner(at)) is not None:
            crossing.append(winner)
        self._deliver(crossing)

    def _carry(self, start: float) -> None:
        """With a bit rate: put the winner's frame on the wire at `start`, for as long as it takes.

        `start` is the wire's own time, which a busy loop is late to notice: a frame grows stale in its queue
        by what goes on on the wire, not because this process had no time.
        """
        self._timer = None
        winner = self._take_winner(start)
        if winner is not None and self._bit_rate is not None:
            end = start + frame_bits(winner[1]) / self._bit_rate
            self._free_at = end
            self._timer = asyncio.get_running_loop().call_at(end - self._lead, self._end, end, *winner)

    def _end(self, due: float, port: MemoryBus, frame: Frame) -> None:
        """The frame has crossed. A loop's timers are late by up to a millisecond, ten frames at 1 Mbit/s.

        So the next frame begins when this one had to end, not when that was noticed.
        """
        self._timer = None
        self._deliver([(port, frame)])
        if self._timer is None:
            self._carry(due)

    def _deliver(self, crossing: Sequence[tuple[MemoryBus | None, Frame]]) -> None:
        """Let the faults have their way with the frames, then hand them to everyone but their senders."""
        loop = asyncio.get_running_loop()
        arriving: list[tuple[MemoryBus | None, Frame]] = []
        for sender, frame in crossing:
            for seconds, outcome in self.faults.apply(frame):
                if seconds > 0:
                    loop.call_later(seconds, self._arrive, [(sender, outcome)])
                else:
                    arriving.append((sender, outcome))
        self._arrive(arriving)

    def _arrive(self, arriving: Sequence[tuple[MemoryBus | None, Frame]]) -> None:
        if not arriving:
            return
        now = asyncio.get_running_loop().time()
        stamped = [(sender, frame._replace(timestamp=now)) for sender, frame in arriving]
        for tap in self._taps:
            for sender, frame in stamped:
                tap("" if sender is None else sender.name, frame)
        for port in self._ports:
            batch = [frame for sender, frame in stamped if sender is not port]
            if batch:
                port.receive(batch)


class MemoryBus:
    """One port of a `MemoryWire`; a `Bus`, with switches for what can happen to an adapter."""

    def __init__(self, wire: MemoryWire, name: str) -> None:
        self._wire = wire
        self._name = name
        self._state = BusState.CLOSED
        self._plugged = True
        self._held = False
        self._listeners = Listeners()
        self._outbox = Outbox(capacity=QUEUE, reserve=URGENT_RESERVE)
        self._emptied = asyncio.Event()
        self._received = 0
        self._sent = 0
        self._reopened = 0

    @property
    def name(self) -> str:
        """What a person calls this port."""
        return self._name

    @property
    def state(self) -> BusState:
        """The state now."""
        return self._state

    @property
    def counters(self) -> BusCounters:
        """What this port carried so far."""
        return BusCounters(self._received, self._sent, self._outbox.dropped, self._reopened)

    @property
    def beside(self) -> None:
        """See `Bus.beside`: the wire is within this process."""
        return

    async def open(self) -> None:
        """See `Bus.open` and `join`."""
        self.join()

    def join(self) -> None:
        """Open at once, which a port on a memory wire can. Raises `BusDown` while unplugged."""
        if self._state is not BusState.CLOSED:
            return
        if not self._plugged:
            raise BusDown(f"{self._name} is unplugged", hint="Plug it in, then open it again.")
        self._change(BusState.ACTIVE, f"{self._name} is open")

    async def close(self) -> None:
        """Leave the wire, after waiting frames had 100 ms to go out. Idempotent."""
        if self._state is BusState.CLOSED:
            return
        if self.foremost(asyncio.get_running_loop().time()) is not None:
            self._emptied.clear()
            try:
                async with asyncio.timeout(CLOSING):
                    await self._emptied.wait()
            except TimeoutError:
                pass
        self._outbox.clear()
        self._change(BusState.CLOSED, f"{self._name} is closed")

    def withdraw(self, cob_ids: Collection[int]) -> int:
        """See `Bus.withdraw`."""
        return self._outbox.withdraw(cob_ids)

    def send(self, frame: Frame, *, urgent: bool = False, answered: bool = True) -> None:
        """See `Bus.send`. Raises `BadValue` for what no controller can send."""
        del answered  # what arrives is handed over at once in any case
        if not self._state.can_send:
            raise BusDown(f"{self._name} is {self._state.value.replace('_', '-')}: the frame was not sent")
        if (
            frame.error
            or len(frame.data) > 8
            or not 0 <= frame.cob_id <= (0x1FFFFFFF if frame.extended else 0x7FF)
        ):
            raise BadValue(f"{frame} is no frame that a controller can send")
        if not self._outbox.put(frame, asyncio.get_running_loop().time(), urgent=urgent):
            raise BusOverflow(f"the transmit queue of {self._name} is full: nobody takes frames off the wire")
        if not self._held:
            self._wire.wake()

    def subscribe(self, on_frames: FrameHandler, on_state: StateHandler | None = None) -> Callable[[], None]:
        """See `Bus.subscribe`."""
        return self._listeners.subscribe(on_frames, on_state)

    # --- switches

    def unplug(self) -> None:
        """The adapter is pulled out: what waited is lost, nothing is heard."""
        self._plugged = False
        if self._state is not BusState.CLOSED:
            self._outbox.clear()
            self._change(BusState.DOWN, f"{self._name} was unplugged")

    def plug(self) -> None:
        """The adapter is back; an open port works again at once."""
        self._plugged = True
        if self._state is BusState.DOWN:
            self._reopened += 1
            self._change(BusState.ACTIVE, f"{self._name} was plugged in again")

    def bus_off(self) -> None:
        """The controller takes itself off the bus; the subscribers see its error frame first."""
        if self._state.can_send:
            self._outbox.clear()
            self._report(BUS_OFF_FRAME)
            self._change(BusState.BUS_OFF, f"the controller of {self._name} went bus-off")

    def recover(self) -> None:
        """The controller was restarted after a bus-off."""
        if self._state is BusState.BUS_OFF:
            self._report(RESTARTED_FRAME)
            self._change(BusState.ACTIVE, f"the controller of {self._name} was restarted")

    def degrade(self, state: BusState) -> None:
        """Pass to `WARNING` or `PASSIVE`, or back to `ACTIVE`, as the controller's error counters would."""
        if not state.can_send:
            raise BadValue(
                f"{state.value} is no state of an error counter", hint="Use bus_off() or unplug()."
            )
        if self._state.can_send:
            self._change(state, f"the controller of {self._name} is error {state.value}")

    def hold(self) -> None:
        """Let nothing out: frames pile up as they do when nobody acknowledges them."""
        self._held = True

    def release(self) -> None:
        """End `hold`."""
        self._held = False
        if self.foremost(asyncio.get_running_loop().time()) is not None:
            self._wire.wake()

    # --- called by the wire

    def foremost(self, at: float) -> Frame | None:
        """The frame that this port would send next at a time of the loop; None if none, or none may leave."""
        if self._held or not self._state.can_send:
            return None
        return self._outbox.foremost(at)

    def take(self) -> None:
        """The foremost frame is on the wire now."""
        self._outbox.pop()
        self._sent += 1
        if not self._outbox:
            self._emptied.set()

    def receive(self, batch: Sequence[Frame]) -> None:
        """Frames of others arrive."""
        if self._state.can_send:
            self._received += len(batch)
            self._listeners.frames(batch)

    # --- inside

    def _report(self, error_frame: Frame) -> None:
        now = asyncio.get_running_loop().time()
        self._received += 1
        self._listeners.frames([error_frame._replace(timestamp=now)])

    def _change(self, state: BusState, reason: str) -> None:
        if state is not self._state:
            self._state = state
            self._listeners.state(state, reason)
