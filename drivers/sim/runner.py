"""The asyncio shell of a simulated module: it joins a `Bus` and keeps one timer, for the next wake-up."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Final, TypeVar

from drivers.bus.base import Bus, BusState
from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryWire
from drivers.devices.profile import DeviceProfile
from drivers.errors import BusError
from drivers.sim.faults import NodeFaults
from drivers.sim.module import SimulatedModule
from drivers.sim.motion.travel import AxisSettings
from drivers.sim.storage import Store

T = TypeVar("T")

ERROR_PASSIVE: Final = 0x8120


class SimulatedNode:
    """A module on a bus. It owns the bus: `start` opens it, `stop` closes it.

    Change the module through `apply` only, or the runner will not see that there is something to send.
    """

    def __init__(self, module: SimulatedModule, bus: Bus) -> None:
        self.module = module
        self.bus = bus
        self.faults = NodeFaults()
        self.lost = 0
        """Frames that the bus did not take."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._unsubscribe: Callable[[], None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._late: set[asyncio.TimerHandle] = set()
        self._bus_was_off = False
        self._reached = float("-inf")

    async def start(self) -> None:
        """Open the bus and power the module on. Raises `drivers.errors.BusDown`."""
        self._loop = asyncio.get_running_loop()
        await self.bus.open()
        self._unsubscribe = self.bus.subscribe(self._on_frames, self._on_state)
        self.power_on()

    async def stop(self) -> None:
        """Power the module off and close the bus. Idempotent."""
        if self._unsubscribe is not None:
            self._unsubscribe()
            self._unsubscribe = None
            self.power_off()
            await self.bus.close()

    async def __aenter__(self) -> SimulatedNode:
        await self.start()
        return self

    async def __aexit__(self, *_exception: object) -> None:
        await self.stop()

    # --- hands on the module --------------------------------------------------------------------------------

    def power_on(self) -> None:
        """Give the module its supply."""
        self._send(self.module.power_on(self._now()))

    def power_off(self) -> None:
        """Take its supply away at once; nothing more is sent."""
        self.module.power_off(self._now())
        for timer in self._late:
            timer.cancel()
        self._late.clear()
        self._schedule()

    def power_cycle(self) -> None:
        """Off and on again in one moment."""
        self.power_off()
        self.power_on()

    def apply(self, change: Callable[[SimulatedModule, float], T]) -> T:
        """Do something to the module (press a switch, set an input), and send what follows from that.

        `change` is given the module and the time: ``apply(lambda module, now: module.axes[0].block(now))``.
        """
        now = self._now()
        self._send(self.module.on_time(now))
        result = change(self.module, now)
        self._send(self.module.on_time(now))
        return result

    def report(self, code: int, detail: int = 0) -> None:
        """Have the module send a module-wide EMCY for an error that is over at once; see its `report`."""
        self._send(self.module.report(code, detail, self._now()))

    # --- bus and clock --------------------------------------------------------------------------------------

    def _on_frames(self, frames: Sequence[Frame]) -> None:
        if self.faults.deaf:
            return
        now = self._now()
        answers: list[Frame] = []
        heard = False
        for frame in frames:
            if self.module.hears(frame):
                heard = True
                answers.extend(self.module.on_frame(frame, now))
        if heard:
            self._send(answers)

    def _on_state(self, state: BusState, _reason: str) -> None:
        if state is BusState.BUS_OFF:
            self.module.bus_off(self._now())
            self._bus_was_off = True
        elif state is BusState.PASSIVE:
            self._send(self.module.report(ERROR_PASSIVE, 0, self._now()))
        elif state.can_send and self._bus_was_off:
            self._bus_was_off = False
            self._send(self.module.bus_on(self._now()))

    def _on_timer(self, due: float) -> None:
        # The loop calls up to its clock's resolution too early; the module would find that nothing is due.
        self._reached = max(self._reached, due)
        self._timer = None
        self._send(self.module.on_time(self._now()))

    def _send(self, frames: Sequence[Frame]) -> None:
        """Hand frames to the bus as the faults have it, then set the timer anew."""
        for frame in frames:
            outcome = self.faults.outgoing(frame)
            if outcome is None:
                continue
            delay, changed = outcome
            if delay > 0:
                self._send_late(delay, changed)
            else:
                self._hand_over(changed)
        self._schedule()

    def _send_late(self, delay: float, frame: Frame) -> None:
        def due() -> None:
            self._late.discard(timer)
            self._hand_over(frame)

        timer = self._running_loop().call_later(delay, due)
        self._late.add(timer)

    def _hand_over(self, frame: Frame) -> None:
        try:
            self.bus.send(frame)
        except BusError:
            self.lost += 1

    def _schedule(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        wakeup = self.module.next_wakeup(self._now())
        if wakeup is not None:
            self._timer = self._running_loop().call_at(wakeup, self._on_timer, wakeup)

    def _now(self) -> float:
        return max(self._running_loop().time(), self._reached)

    def _running_loop(self) -> asyncio.AbstractEventLoop:
        if self._loop is None:
            self._loop = asyncio.get_running_loop()
        return self._loop


@asynccontextmanager
async def simulated_node(
    wire: MemoryWire,
    profile: DeviceProfile,
    node_id: int = 1,
    *,
    axes: Sequence[AxisSettings] | None = None,
    store: Store | None = None,
    serial: int = 1,
) -> AsyncGenerator[SimulatedNode]:
    """A running module on a port of its own of `wire`, stopped at the end."""
    module = SimulatedModule(profile, node_id, axes=axes, store=store, serial=serial)
    async with SimulatedNode(module, wire.port(f"node {node_id}")) as node:
        yield node
