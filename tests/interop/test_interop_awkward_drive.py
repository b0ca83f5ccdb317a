"""Our master against a drive with the oddities of real ones, on a virtual clock."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
from awkward_drive import AwkwardDrive, Oddities

from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryWire
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import NotReady
from drivers.master.motions.motion import MotionState
from drivers.master.network import Network
from drivers.master.plan.configuration import NetworkConfig, NodeConfig
from drivers.master.plan.requests import MoveRequest
from drivers.master.seen.status import Failsafe, NodeState

pytestmark = pytest.mark.looptime

PROFILE = Catalog.load().profile("TMCM-3216")
SIZES = {
    (spec.index, spec.sub): spec.type.size or 8
    for spec in PROFILE.objects.values()
    if spec.type.size is not None
}
ODDITIES = {
    "none": Oddities(),
    "sizes not indicated": Oddities(sizes_not_indicated=True),
    "everything segmented": Oddities(everything_segmented=True),
    "garbage in reserved bytes": Oddities(garbage_in_reserved=True),
    "bit 30 of a COB-ID forgotten": Oddities(forgets_rtr_bit=True),
    "the maker's bits of the statusword": Oddities(other_status_bits=0x8100),
    "boot-up said three times": Oddities(boot_ups=3),
    "no revision and no serial number": Oddities(missing=frozenset({(0x1018, 3), (0x1018, 4)})),
    "no version strings": Oddities(missing=frozenset({(0x1008, 0), (0x1009, 0), (0x100A, 0)})),
}
ODDITIES["all of these"] = Oddities(
    sizes_not_indicated=True,
    garbage_in_reserved=True,
    forgets_rtr_bit=True,
    other_status_bits=0x8100,
    boot_ups=3,
    missing=frozenset({(0x1018, 3), (0x1018, 4), (0x1009, 0), (0x100A, 0)}),
)


class Lab:
    def __init__(self, wire: MemoryWire, drive: AwkwardDrive, network: Network) -> None:
        self.wire, self.drive, self.network = wire, drive, network
        self.node = network.node(1)

    async def until(self, *states: NodeState) -> None:
        async with asyncio.timeout(60):
            while self.node.state not in states:  # noqa: ASYNC110 - the clock is virtual
                await asyncio.sleep(0.01)


@asynccontextmanager
async def lab(oddities: Oddities) -> AsyncIterator[Lab]:
    wire = MemoryWire(bit_rate=1_000_000)
    drive = AwkwardDrive(wire.port("drive"), SIZES, oddities)
    config = NetworkConfig(nodes=(NodeConfig(node_id=1, name="stage"),))
    async with drive, Network(wire.port("master"), config, Catalog.load()) as network:
        yield Lab(wire, drive, network)


@pytest.mark.parametrize("name", ODDITIES)
async def test_it_is_taken_in_enabled_moved_stopped_and_disabled(name: str) -> None:
    async with lab(ODDITIES[name]) as here:
        await here.until(NodeState.OPERATIONAL, NodeState.REFUSED)
        assert here.node.state is NodeState.OPERATIONAL, here.node.reason
        axes = here.node.axes
        await asyncio.gather(*(axis.enable() for axis in axes))
        for axis in axes:
            motion = axis.move_to(MoveRequest(1000 * (axis.number + 1)))
            await motion.wait(20)
            assert motion.state is MotionState.SUCCEEDED, motion.error
        assert [axis.status.position for axis in axes] == [1000, 2000, 3000]
        await axes[0].stop()
        await axes[0].disable()
        assert axes[0].status.state is PowerState.SWITCH_ON_DISABLED


async def test_without_1029h_it_is_used_but_not_enabled() -> None:
    async with lab(Oddities(missing=frozenset({(0x1029, 0), (0x1029, 1), (0x1029, 2)}))) as here:
        await here.until(NodeState.OPERATIONAL)
        assert here.node.failsafe is Failsafe.OFF
        with pytest.raises(NotReady) as refused:
            await here.node.axes[0].enable()
        assert [each.code for each in refused.value.obstacles] == ["failsafe_off"]


async def test_process_data_longer_than_what_is_mapped_is_not_believed() -> None:
    async with lab(Oddities(padded_pdos=True)) as here:
        await here.until(NodeState.LOST)
        assert "status of axis" in here.node.reason
        assert here.node.counters.short_pdos > 0


@pytest.mark.parametrize("index", [0x1016, 0x1017, 0x1A00])
async def test_what_it_must_take_and_refuses_is_named(index: int) -> None:
    async with lab(Oddities(read_only=frozenset({index}))) as here:
        await here.until(NodeState.REFUSED)
        assert f"{index:04X}" in here.node.reason
        assert here.network.failure is None


async def test_emergencies_of_any_length_and_bytes_are_taken_or_counted() -> None:
    async with lab(Oddities()) as here:
        await here.until(NodeState.OPERATIONAL)
        for length in range(9):
            here.wire.inject(Frame(0x081, bytes([0xFF, 0x5A, 0xFF, 7, 200, 0xFF, 0xFF, 0xFF][:length])))
        await asyncio.sleep(0.1)
        counters = here.node.counters
        assert (counters.malformed_emergencies, counters.emergencies) == (8, 1)
        [record] = here.node.emergencies
        assert (record.code, record.title != "", record.remedy != "") == (0x5AFF, True, True)
        assert here.network.failure is None


async def test_heartbeats_with_a_toggling_bit_are_not_taken_for_a_state() -> None:
    async with lab(replace(Oddities(), toggling_heartbeat=True)) as here:
        await asyncio.sleep(30)
        assert here.node.counters.malformed_heartbeats > 0
        assert here.network.failure is None
