"""The simulated module on a memory wire, on a virtual clock: what another node on the bus sees of it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import pytest

from drivers.bus.base import Bus, BusState
from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.cia301.nmt import NmtState
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile
from drivers.sim.module import SimulatedModule
from drivers.sim.runner import SimulatedNode, simulated_node

pytestmark = pytest.mark.looptime


@lru_cache
def profile() -> DeviceProfile:
    return Catalog.load().profile("TMCM-3216")


@dataclass
class Observer:
    """Another node: it sends frames, and keeps each frame that it hears with the time."""

    bus: Bus
    heard: list[tuple[float, str]] = field(default_factory=list)

    def on_frames(self, frames: Sequence[Frame]) -> None:
        now = asyncio.get_running_loop().time()
        self.heard += [(now, f"{frame.cob_id:03X}#{frame.data.hex(' ')}") for frame in frames]

    def send(self, cob_id: int, data: str = "") -> None:
        self.bus.send(Frame(cob_id, bytes.fromhex(data)))

    def write(self, *requests: str) -> None:
        for request in requests:
            self.send(0x601, request)

    @property
    def frames(self) -> list[str]:
        return [frame for _, frame in self.heard]

    def take(self) -> list[str]:
        frames = self.frames
        self.heard.clear()
        return frames

    def times(self, start: str) -> list[float]:
        return [time for time, frame in self.heard if frame.startswith(start)]


@pytest.fixture
def wire() -> MemoryWire:
    return MemoryWire()


@pytest.fixture
async def observer(wire: MemoryWire) -> AsyncIterator[Observer]:
    observer = Observer(wire.port("observer"))
    await observer.bus.open()
    observer.bus.subscribe(observer.on_frames)
    yield observer
    await observer.bus.close()


@pytest.fixture
async def node(wire: MemoryWire, observer: Observer) -> AsyncIterator[SimulatedNode]:
    async with simulated_node(wire, profile()) as node:
        await turn()
        yield node


def wire_end(node: SimulatedNode) -> MemoryBus:
    """Its end of the wire, which can be damaged."""
    assert isinstance(node.bus, MemoryBus)
    return node.bus


async def turn() -> None:
    """Let what was sent arrive and be answered."""
    for _ in range(6):
        await asyncio.sleep(0)


async def test_it_boots_and_answers(node: SimulatedNode, observer: Observer) -> None:
    assert observer.take() == ["701#00"]
    observer.write("40 00 10 00 00 00 00 00")
    await turn()
    assert observer.take() == ["581#43 00 10 00 92 01 fc ff"]


async def test_its_heartbeat_keeps_time(node: SimulatedNode, observer: Observer) -> None:
    observer.write("2b 17 10 00 c8 00 00 00")
    await asyncio.sleep(10.1)
    times = observer.times("701#7f")
    assert len(times) == 51
    assert times[-1] - times[0] == pytest.approx(10.0, abs=1e-3)


async def test_a_lost_master_stops_it_within_the_time(node: SimulatedNode, observer: Observer) -> None:
    observer.write("23 16 10 01 2c 01 7f 00")
    observer.send(0x000, "01 01")
    for _ in range(5):
        observer.send(0x77F, "05")
        await asyncio.sleep(0.1)
    assert node.module.nmt_state is NmtState.OPERATIONAL
    await asyncio.sleep(0.19)
    assert node.module.nmt_state is NmtState.OPERATIONAL
    await asyncio.sleep(0.02)
    assert node.module.nmt_state is NmtState.STOPPED
    assert observer.frames[-1] == "081#30 81 11 00 ff 00 00 00"


async def test_twenty_idle_modules_set_no_timer_and_do_nothing(wire: MemoryWire, observer: Observer) -> None:
    nodes = [
        SimulatedNode(SimulatedModule(profile(), number), wire.port(f"{number}")) for number in range(1, 21)
    ]
    for node in nodes:
        await node.start()
    observer.send(0x000, "01 00")
    await turn()
    observer.take()
    assert all(node.module.nmt_state is NmtState.OPERATIONAL for node in nodes)
    assert all(node.module.next_wakeup(0.0) is None for node in nodes)
    await asyncio.sleep(1_000_000)
    assert observer.frames == []
    for node in nodes:
        await node.stop()


async def test_a_power_cycle_is_seen_as_a_boot_up_and_forgets(
    node: SimulatedNode, observer: Observer
) -> None:
    observer.write("2b 17 10 00 c8 00 00 00")
    await asyncio.sleep(1.1)
    observer.take()
    node.power_cycle()
    await asyncio.sleep(5)
    assert observer.take() == ["701#00"]


async def test_without_supply_it_says_nothing(node: SimulatedNode, observer: Observer) -> None:
    observer.write("2b 17 10 00 c8 00 00 00")
    await asyncio.sleep(1.1)
    node.power_off()
    observer.take()
    observer.write("40 00 10 00 00 00 00 00")
    await asyncio.sleep(5)
    assert observer.frames == []
    node.power_on()
    await turn()
    assert observer.frames == ["701#00"]


async def test_a_stopped_node_leaves_no_timer_and_no_port(wire: MemoryWire, observer: Observer) -> None:
    async with simulated_node(wire, profile()) as node:
        observer.write("2b 17 10 00 c8 00 00 00")
        await asyncio.sleep(1)
    observer.take()
    await asyncio.sleep(5)
    assert observer.frames == []
    await node.stop()


async def test_late_and_missing_sdo_answers(node: SimulatedNode, observer: Observer) -> None:
    observer.take()
    node.faults.sdo_delay = 0.5
    observer.write("40 00 10 00 00 00 00 00")
    await asyncio.sleep(0.499)
    assert observer.frames == []
    await asyncio.sleep(0.002)
    assert len(observer.take()) == 1
    node.faults.sdo_mute = True
    observer.write("2b 17 10 00 c8 00 00 00")
    await asyncio.sleep(0.1)
    assert set(observer.take()) == {"701#7f"}, "it was carried out, but not answered"


async def test_an_answer_that_is_late_dies_with_the_supply(node: SimulatedNode, observer: Observer) -> None:
    observer.take()
    node.faults.sdo_delay = 0.5
    observer.write("40 00 10 00 00 00 00 00")
    await asyncio.sleep(0.1)
    node.power_off()
    await asyncio.sleep(1)
    assert observer.frames == []


async def test_silent_deaf_without_boot_up_and_corrupt(node: SimulatedNode, observer: Observer) -> None:
    observer.take()
    node.faults.no_boot_up = True
    node.power_cycle()
    await turn()
    assert observer.take() == []
    node.faults.clear()
    node.faults.silent = True
    observer.write("2b 17 10 00 c8 00 00 00")
    await asyncio.sleep(1)
    assert observer.take() == []
    node.faults.clear()
    node.faults.deaf = True
    observer.write("40 00 10 00 00 00 00 00")
    await asyncio.sleep(0.9)
    assert set(observer.take()) == {"701#7f"}
    node.faults.clear()
    node.faults.corrupt = lambda frame: frame._replace(data=frame.data[:3])
    observer.write("40 00 10 00 00 00 00 00")
    await turn()
    assert "581#43 00 10" in observer.take()
    node.faults.corrupt = lambda _frame: None
    await asyncio.sleep(1)
    assert observer.take() == []


async def test_bus_off_is_told_when_it_is_over(node: SimulatedNode, observer: Observer) -> None:
    observer.take()
    wire_end(node).bus_off()
    observer.send(0x000, "01 01")
    await turn()
    assert node.module.nmt_state is NmtState.PRE_OPERATIONAL, "it can't hear"
    wire_end(node).recover()
    await turn()
    assert observer.frames == ["081#40 81 11 00 ff 00 00 00"]


async def test_error_passive_is_told(node: SimulatedNode, observer: Observer) -> None:
    observer.take()
    wire_end(node).degrade(BusState.PASSIVE)
    await turn()
    assert observer.frames == ["081#20 81 11 00 ff 00 00 00"]


async def test_what_the_bus_does_not_take_is_counted(node: SimulatedNode, observer: Observer) -> None:
    observer.write("2b 17 10 00 0a 00 00 00")
    await turn()
    wire_end(node).unplug()
    await asyncio.sleep(0.1)
    assert node.lost == pytest.approx(10, abs=1)


async def test_an_input_that_changes_is_sent_at_once(node: SimulatedNode, observer: Observer) -> None:
    observer.write(
        "2f 40 1a 00 00 00 00 00",
        "23 40 1a 01 20 00 02 27",
        "2f 40 1a 00 01 00 00 00",
        "23 40 18 01 82 01 00 40",
    )
    observer.send(0x000, "01 01")
    await turn()
    observer.take()
    node.apply(lambda module, _now: module.terminals.apply(1, True))
    await turn()
    assert observer.frames == ["182#00 00 02 00"]


# --- with the drive ----------------------------------------------------------------------------------------


def enable(observer: Observer, mode: int) -> None:
    """Parameters without which nothing moves, the mode, and the way to OPERATION_ENABLED, all by SDO."""
    observer.write(
        "23 05 20 00 03 00 00 00",
        "23 10 20 00 0a 00 00 00",
        "23 82 60 00 0a 00 00 00",
        "23 13 20 00 80 1a 06 00",
        "23 18 20 00 80 1a 06 00",
        "23 83 60 00 40 0d 03 00",
        "23 84 60 00 40 0d 03 00",
        "23 81 60 00 a0 86 01 00",
        "23 67 60 00 00 00 00 00",
        f"2f 60 60 00 {mode:02x} 00 00 00",
        "2b 40 60 00 06 00 00 00",
        "2b 40 60 00 07 00 00 00",
        "2b 40 60 00 0f 00 00 00",
    )


async def test_a_move_by_pdo_is_reported_by_pdo(node: SimulatedNode, observer: Observer) -> None:
    enable(observer, 1)
    await turn()
    assert [frame for frame in observer.frames if frame.startswith("581#80")] == []
    assert node.module.axes[0].state is PowerState.OPERATION_ENABLED
    observer.write(
        "23 02 18 01 81 03 00 c0",
        "2f 02 18 02 ff 00 00 00",
        "2b 02 18 03 64 00 00 00",  # 10 ms
        "23 02 18 01 81 03 00 40",
    )
    observer.send(0x000, "01 01")
    await turn()
    observer.take()
    observer.send(0x401, "1f 00 50 c3 00 00")
    observer.send(0x401, "0f 00 50 c3 00 00")
    await asyncio.sleep(5)
    positions = [
        int.from_bytes(bytes.fromhex(f[10:].replace(" ", "")), "little", signed=True)
        for f in observer.frames
        if f.startswith("381#")
    ]
    times = observer.times("381#")
    assert positions == sorted(positions)
    assert positions[-1] == 50_000
    assert all(b - a >= 0.01 - 1e-6 for a, b in pairwise(times))
    assert 40 <= len(times) <= 110
    last = [frame for frame in observer.frames if frame.startswith("181#")][-1]
    assert int.from_bytes(bytes.fromhex(last[4:].replace(" ", "")), "little") & 0x5400 == 0x0400
    assert node.module.next_wakeup(5.0) is None, "it is idle again"


async def test_nmt_stopped_faults_an_enabled_axis(node: SimulatedNode, observer: Observer) -> None:
    enable(observer, 3)
    observer.send(0x000, "02 01")
    await asyncio.sleep(1)
    assert node.module.axes[0].state is PowerState.FAULT
    assert node.module.axes[1].state is PowerState.SWITCH_ON_DISABLED


async def test_the_shutdown_switch_is_told_once_for_all_axes(node: SimulatedNode, observer: Observer) -> None:
    observer.take()
    node.apply(lambda module, now: module.shutdown_switch(True, now))
    await turn()
    emergencies = [frame for frame in observer.frames if frame.startswith("081")]
    assert len(emergencies) == 1
    assert emergencies[0].startswith("081#41 54")
    assert emergencies[0].endswith("00 ff 00 00 00")


async def test_an_undervoltage_of_one_axis_names_it_and_stays_in_1001h(
    node: SimulatedNode, observer: Observer
) -> None:
    observer.take()
    node.apply(lambda module, now: module.axes[2].supply(3.0, now))
    await turn()
    assert observer.frames[0].startswith("081#00 ff")
    assert observer.frames[0][13:18] == "00 02"
    assert node.module.error_register
