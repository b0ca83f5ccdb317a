"""The faults of a run, all drawn from its seed: what happens to frames, modules, adapter and event loop."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from virtual_loop import VirtualLoop

from drivers.bus.faults import Faults, Outcome
from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.nmt import NmtCommand
from drivers.cia301.nmt import encode as nmt_frame

if TYPE_CHECKING:
    from seed_world import World

LATEST = 0.2
"""Seconds by which a frame may be late on the wire, beside others that aren't; well below the 0.25 s of
`Timing.sdo_quarantine`, the worst lateness that the master counts on.
"""
LATEST_ANSWER = 0.5
"""Seconds by which a module may be late with an SDO answer."""
_STEP = 1e-6


@dataclass(slots=True)
class Window:
    """What happens, with some probability, to frames of some identifiers until a time."""

    kind: str
    cob_ids: frozenset[int]
    """Empty: all."""
    probability: float
    until: float
    seconds: float = 0.0


class Weather(Faults):
    """What becomes of each frame that crosses the wire. Frames of one identifier stay in their order."""

    def __init__(
        self, rng: random.Random, on_frame: Callable[[Frame], None], note: Callable[[str], None]
    ) -> None:
        super().__init__()
        self._rng = rng
        self._on_frame = on_frame
        self._note = note
        self._windows: list[Window] = []
        self._busy: dict[int, float] = {}

    def begin(self, window: Window) -> None:
        """Bad weather for a while."""
        self._windows.append(window)

    def clear(self) -> None:
        """Fair weather from now on; what is late already stays late."""
        super().clear()
        self._windows.clear()

    def apply(self, frame: Frame) -> list[Outcome]:
        """See `Faults.apply`."""
        now = asyncio.get_running_loop().time()
        self._on_frame(frame)
        outcomes: list[Outcome] = [(0.0, frame)]
        for window in self._windows:
            if window.until < now or (window.cob_ids and frame.cob_id not in window.cob_ids):
                continue
            if self._rng.random() >= window.probability:
                continue
            self._note(f"{window.kind} {frame}")
            outcomes = [outcome for one in outcomes for outcome in self._change(window, *one)]
        if outcomes == [(0.0, frame)] and frame.cob_id not in self._busy:
            return outcomes
        return [(self._in_order(frame.cob_id, now, late), changed) for late, changed in outcomes]

    def _change(self, window: Window, late: float, frame: Frame) -> list[Outcome]:
        match window.kind:
            case "lose":
                return []
            case "duplicate":
                return [(late, frame), (late, frame)]
            case "delay":
                return [(late + self._rng.uniform(0.0, window.seconds), frame)]
            case "cut":
                return [(late, frame._replace(data=frame.data[: self._rng.randrange(len(frame.data) + 1)]))]
            case "lengthen":
                return [
                    (
                        late,
                        frame._replace(
                            data=(frame.data + bytes(8))[: len(frame.data) + self._rng.randrange(1, 4)][:8]
                        ),
                    )
                ]
            case kind:
                raise ValueError(kind)

    def _in_order(self, cob_id: int, now: float, late: float) -> float:
        """A frame never overtakes one of its own identifier, on no wire and through no gateway."""
        due = now + late
        before = self._busy.get(cob_id, 0.0)
        if before > now:
            due = max(due, before + _STEP)
        if due <= now:
            self._busy.pop(cob_id, None)
            return 0.0
        self._busy[cob_id] = due
        return due - now


Act = Callable[["Storm", float], Awaitable[None] | None]


class Storm:
    """Draws the faults of one run and plays them."""

    def __init__(self, world: World, rng: random.Random, seconds: float) -> None:
        self._world = world
        self._rng = rng
        self.seconds = seconds
        many = rng.choice((0, 1, 2, 3, 5, 8, 13))
        self._plan = sorted((rng.uniform(0.3, seconds), rng.choice(_KINDS)) for _ in range(many))

    async def play(self) -> None:
        """Until the storm's end; everything is whole again then."""
        loop = asyncio.get_running_loop()
        start = loop.time()
        async with asyncio.TaskGroup() as group:
            for at, kind in self._plan:
                await asyncio.sleep(start + at - loop.time())
                group.create_task(self._strike(kind))
            await asyncio.sleep(max(0.0, start + self.seconds - loop.time()))
        self._world.mend()

    async def _strike(self, kind: str) -> None:
        lasts = self._rng.choice((0.02, 0.1, 0.3, 0.7, 1.2, 2.5))
        await getattr(self, f"_{kind}")(lasts)

    # --- the wire

    async def _weather(self, lasts: float) -> None:
        kind = self._rng.choice(("lose", "lose", "duplicate", "delay", "delay", "cut", "lengthen"))
        probability = self._rng.choice((0.03, 0.3, 1.0))
        seconds = self._rng.choice((0.001, 0.004, 0.05, LATEST))
        cob_ids = frozenset(self._rng.sample(self._world.cob_ids, self._rng.choice((1, 1, 3))))
        if self._rng.random() < 0.2:
            cob_ids = frozenset()
            probability = min(probability, 0.3)
        where = ",".join(f"{cob_id:X}" for cob_id in sorted(cob_ids)) or "all"
        self._note(f"{kind} {where} p={probability} up to {seconds} s, for {lasts} s")
        until = asyncio.get_running_loop().time() + lasts
        self._world.weather.begin(Window(kind, cob_ids, probability, until, seconds))

    async def _noise(self, lasts: float) -> None:
        self._note("identifiers of nobody, and error frames")
        taken = set(self._world.cob_ids)
        for _ in range(self._rng.choice((3, 40, 400))):
            cob_id = self._rng.randrange(0x800)
            data = self._rng.randbytes(self._rng.randrange(9))
            kind = self._rng.randrange(4)
            if kind == 0:
                self._world.wire.inject(Frame(self._rng.choice(self._world.cob_ids), bytes(8), error=True))
            elif kind == 1:
                self._world.wire.inject(Frame(self._rng.randrange(1 << 29), data, extended=True))
            elif kind == 2:
                self._world.wire.inject(Frame(self._rng.choice(self._world.cob_ids), remote=True))
            elif cob_id not in taken and not _is_service(cob_id):
                self._world.wire.inject(Frame(cob_id, data))
            await asyncio.sleep(lasts / 400)

    # --- the adapter and the event loop

    async def _unplug(self, lasts: float) -> None:
        self._note(f"the adapter is unplugged for {lasts} s")
        self._world.port.unplug()
        await asyncio.sleep(lasts)
        self._world.port.plug()
        self._note("the adapter is back")

    async def _bus_off(self, lasts: float) -> None:
        self._note(f"our controller goes bus-off for {lasts} s")
        self._world.port.bus_off()
        await asyncio.sleep(lasts)
        self._world.port.recover()
        self._note("our controller is back")

    async def _hold(self, lasts: float) -> None:
        self._note(f"our transmit queue stands for {lasts} s")
        self._world.port.hold()
        await asyncio.sleep(lasts)
        self._world.port.release()

    async def _stall(self, lasts: float) -> None:
        self._note(f"the event loop stalls for {lasts} s")
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        loop.stall(lasts)
        await asyncio.sleep(lasts)

    # --- a module

    async def _reset(self, lasts: float) -> None:
        node_id = self._pick()
        self._note(f"module {node_id} resets itself")
        self._world.power_cycle(node_id)

    async def _power(self, lasts: float) -> None:
        node_id = self._pick()
        self._note(f"module {node_id} is without supply for {lasts} s")
        self._world.power_off(node_id)
        await asyncio.sleep(lasts)
        self._world.power_on(node_id)

    async def _cable(self, lasts: float) -> None:
        node_id = self._pick()
        self._note(f"the cable of module {node_id} is off for {lasts} s")
        port = self._world.module_ports[node_id]
        port.unplug()
        await asyncio.sleep(lasts)
        port.plug()

    async def _module_bus_off(self, lasts: float) -> None:
        node_id = self._pick()
        self._note(f"module {node_id} goes bus-off for {lasts} s")
        port = self._world.module_ports[node_id]
        port.bus_off()
        await asyncio.sleep(lasts)
        port.recover()

    async def _silent(self, lasts: float) -> None:
        await self._switch("silent", lasts)

    async def _deaf(self, lasts: float) -> None:
        await self._switch("deaf", lasts)

    async def _sdo_mute(self, lasts: float) -> None:
        await self._switch("sdo_mute", lasts)

    async def _switch(self, name: str, lasts: float) -> None:
        node_id = self._pick()
        self._note(f"module {node_id} is {name} for {lasts} s")
        faults = self._world.modules[node_id].faults
        setattr(faults, name, True)
        await asyncio.sleep(lasts)
        setattr(faults, name, False)

    async def _slow_answers(self, lasts: float) -> None:
        node_id = self._pick()
        seconds = self._rng.choice((0.01, 0.1, 0.29, 0.31, LATEST_ANSWER))
        self._note(f"module {node_id} answers SDOs {seconds} s late for {lasts} s")
        self._world.modules[node_id].faults.sdo_delay = seconds
        await asyncio.sleep(lasts)
        self._world.modules[node_id].faults.sdo_delay = 0.0

    async def _sdo_aborts(self, lasts: float) -> None:
        node_id = self._pick()
        code = self._rng.choice((0x05040000, 0x06020000, 0x08000000, 0x08000022, 0x06090030))
        self._note(f"module {node_id} aborts SDOs with {code:08X}h for {lasts} s")

        def abort(frame: Frame) -> Frame:
            if frame.cob_id == cob.sdo_response(node_id) and self._rng.random() < 0.5:
                return frame._replace(data=b"\x80" + frame.data[1:4] + code.to_bytes(4, "little"))
            return frame

        self._world.modules[node_id].faults.corrupt = abort
        await asyncio.sleep(lasts)
        self._world.modules[node_id].faults.corrupt = None

    async def _emergencies(self, lasts: float) -> None:
        node_id = self._pick()
        code = self._rng.choice((0x8110, 0x8110, 0x8140, 0x8120, 0x8100, 0x5112))
        many = self._rng.choice((1, 1, 30, 300))
        self._note(f"module {node_id} sends {many} EMCY {code:04X}h")
        for _ in range(many):
            self._world.modules[node_id].report(code)
            await asyncio.sleep(lasts / 300)

    async def _stranger(self, lasts: float) -> None:
        """A second master."""
        command = self._rng.choice(tuple(NmtCommand))
        node_id = self._rng.choice((0, self._pick()))
        self._note(f"a stranger commands NMT {command.name} to {node_id}")
        self._world.stranger_commands(command, node_id)
        self._world.wire.inject(Frame(cob.NMT, nmt_frame(command, node_id)))

    async def _syncs(self, lasts: float) -> None:
        """A second master's: they must start nothing that isn't being started anyway."""
        self._note(f"a stranger sends SYNCs for {lasts} s")
        for _ in range(self._rng.choice((1, 5, 40))):
            self._world.wire.inject(Frame(cob.SYNC))
            await asyncio.sleep(lasts / 40)

    # --- inside

    def _pick(self) -> int:
        return self._rng.choice(sorted(self._world.modules))

    def _note(self, text: str) -> None:
        self._world.trace.note("FAULT", text)


_KINDS = (
    "weather", "weather", "weather", "weather", "noise", "unplug", "bus_off", "hold", "stall", "stall",
    "reset", "reset", "power", "cable", "module_bus_off", "silent", "deaf", "sdo_mute",
    "slow_answers", "slow_answers", "sdo_aborts", "emergencies", "emergencies", "stranger",
    "syncs", "syncs",
)  # fmt: skip


def _is_service(cob_id: int) -> bool:
    """Whether an identifier means something to some node: NMT, SYNC, EMCY, TIME, SDO, heartbeats, LSS."""
    return cob_id in (0x000, 0x100) or 0x080 <= cob_id < 0x180 or cob_id >= 0x580
