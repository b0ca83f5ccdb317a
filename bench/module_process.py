"""A simulated module in a process of its own, on one end of a `bench.wire`, that can fill the bus.

    python -m bench.module_process DESCRIPTOR

Takes a command a line and answers each with a line of JSON: `flood` repeats the module's last status PDOs at
rate of a full bus, one frame at a time as the wire would bring them; `quiet` ends that; `counts` tells what
was sent; `halts` tells when each halt arrived: COB-ID and nanoseconds of the system's clock, as the kernel
took them.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import json
import socket
import sys
import threading
import time
from collections.abc import Callable, Collection

from bench.wire import CAN_FRAME, FULL_BUS, pack
from drivers.bus.base import Beside, BusCounters, BusState, FrameHandler, StateHandler
from drivers.bus.frame import Frame
from drivers.cia402.power import Controlword
from drivers.devices.catalog import Catalog
from drivers.sim.module import SimulatedModule
from drivers.sim.runner import SimulatedNode

NODE_ID = 1
_SO_TIMESTAMPNS = 35
_PR_SET_TIMERSLACK = 29
_TPDOS = range(0x180, 0x500)
_RPDOS = (0x200, 0x300, 0x400, 0x500)
_FUNCTION = 0x780


class WireBus:
    """A `Bus` on one end of a wire that counts what it sends, and notes when halts arrive."""

    name = "bench"
    state = BusState.ACTIVE
    counters = BusCounters()
    beside: Beside | None = None

    def __init__(self, end: socket.socket) -> None:
        end.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self.end = end
        self.sent = 0
        self.refused = 0
        """Frames for which the receiver's room was full: a CAN socket would have lost them."""
        self.status: dict[int, bytes] = {}
        """The newest frame of each status PDO."""
        self.halts: list[tuple[int, int]] = []
        self._sending = threading.Lock()
        self._subscribers: list[FrameHandler] = []

    async def open(self) -> None:
        """Listen."""
        asyncio.get_running_loop().add_reader(self.end.fileno(), self._readable)

    async def close(self) -> None:
        """Listen no more."""
        asyncio.get_running_loop().remove_reader(self.end.fileno())

    def subscribe(self, on_frames: FrameHandler, on_state: StateHandler | None = None) -> Callable[[], None]:
        """See `Bus.subscribe`."""
        del on_state
        self._subscribers.append(on_frames)
        return lambda: self._subscribers.remove(on_frames)

    def withdraw(self, cob_ids: Collection[int]) -> int:
        """See `Bus.withdraw`: nothing waits here."""
        del cob_ids
        return 0

    def send(self, frame: Frame, *, urgent: bool = False, answered: bool = True) -> None:
        """See `Bus.send`."""
        del urgent, answered
        raw = pack(frame.cob_id, frame.data)
        if frame.cob_id in _TPDOS and frame.cob_id & _FUNCTION not in (0x080, *_RPDOS):
            self.status[frame.cob_id] = raw
        self.put(raw)

    def put(self, raw: bytes) -> None:
        """Send from either thread."""
        with self._sending:
            try:
                self.end.send(raw)
            except BlockingIOError:
                self.refused += 1
            else:
                self.sent += 1

    def _readable(self) -> None:
        frames: list[Frame] = []
        with contextlib.suppress(BlockingIOError):
            while True:
                raw, ancillary, _, _ = self.end.recvmsg(CAN_FRAME.size, 64)
                if not raw:
                    sys.exit(0)
                cob_id, length, data = CAN_FRAME.unpack(raw)
                if cob_id & _FUNCTION in _RPDOS and data[1] & (Controlword.HALT >> 8):
                    seconds, nanoseconds = (
                        int.from_bytes(ancillary[0][2][at : at + 8], sys.byteorder) for at in (0, 8)
                    )
                    self.halts.append((cob_id, seconds * 1_000_000_000 + nanoseconds))
                frames.append(Frame(cob_id, data[:length]))
        for on_frames in self._subscribers:
            on_frames(frames)


class Flood:
    """A thread that keeps the bus full."""

    def __init__(self, bus: WireBus) -> None:
        self._bus = bus
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End it."""
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)
        identifiers = sorted(self._bus.status)
        began, sent = time.monotonic(), 0
        while not self._end.is_set():
            due = int((time.monotonic() - began) * FULL_BUS)
            while sent < due:
                self._bus.put(self._bus.status[identifiers[sent % len(identifiers)]])
                sent += 1
            time.sleep(max(0.0, began + (sent + 1) / FULL_BUS - time.monotonic()))


class Commands:
    """What the benchmark asks of this process."""

    def __init__(self, bus: WireBus) -> None:
        self._bus = bus
        self._flood: Flood | None = None

    def serve(self, _: socket.socket | None = None) -> None:
        """One line of standard input."""
        line = sys.stdin.readline()
        if not line:
            sys.exit(0)
        print(json.dumps(getattr(self, line.strip())()), flush=True)

    def flood(self) -> None:
        """Fill the bus."""
        self._flood = self._flood or Flood(self._bus)

    def quiet(self) -> None:
        """Leave it to the module."""
        if self._flood is not None:
            self._flood.stop()
            self._flood = None

    def counts(self) -> dict[str, int]:
        """Frames that went, and that found no room."""
        return {"sent": self._bus.sent, "refused": self._bus.refused}

    def halts(self) -> list[tuple[int, int]]:
        """Every halt that arrived since the last time."""
        found, self._bus.halts = self._bus.halts, []
        return found


async def main(end: socket.socket) -> None:
    """Run the module until standard input or the wire ends."""
    bus = WireBus(end)
    commands = Commands(bus)
    module = SimulatedModule(Catalog.load().profile("TMCM-3216"), NODE_ID)
    async with SimulatedNode(module, bus):
        asyncio.get_running_loop().add_reader(sys.stdin.fileno(), commands.serve)
        print(json.dumps("ready"), flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(main(socket.socket(fileno=int(sys.argv[1]))))
