"""What simulated modules cost: CPU of this process while N of them idle, and while all their axes turn.

Each module turns three axes at a constant velocity (pv) and sends two TPDOs per axis every 10 ms (statusword;
position and velocity), on one in-memory wire without a bit rate: nothing but the modules and the wire is
measured. 100 % is one core.
"""

from __future__ import annotations

import asyncio
import sys
import time

from bench.parts import main
from bench.report import Row
from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryWire
from drivers.cia301 import cob
from drivers.cia301.nmt import NmtCommand, encode
from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.pdo import Direction, PdoConfiguration, PdoMapping, remap_steps
from drivers.cia301.sdo import SdoDownload
from drivers.cia301.types import encode as encode_value
from drivers.cia402 import objects
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile
from drivers.sim.module import SimulatedModule
from drivers.sim.motion.travel import AxisSettings
from drivers.sim.station import Station

ENDLESS = AxisSettings(travel_min=None, travel_max=None, negative_limit=None, positive_limit=None)
PERIOD_100US = 100
MODULES = 20
SETTLING = 1.0
"""Seconds after which all axes turn."""


def id_of(module: SimulatedModule) -> int:
    """Its node ID: it has one, as nobody took it away."""
    assert module.node_id is not None
    return module.node_id


def write(module: SimulatedModule, profile: DeviceProfile, address: Address, value: int, now: float) -> None:
    """One expedited SDO download into the module."""
    spec = profile.objects[address]
    request = SdoDownload(address, encode_value(spec.type, value)).request()
    answers = module.on_frame(Frame(cob.sdo_request(id_of(module)), request), now)
    assert answers, address
    assert answers[0].data[0] == 0x60, (str(address), answers[0])


def set_turning(module: SimulatedModule, now: float, profile: DeviceProfile) -> None:
    """All axes at 20,000 pps, all their status TPDOs each 10 ms."""
    for axis in range(profile.axes):

        def index(base: int, axis: int = axis) -> int:
            return profile.layout.index(base, axis)

        for base, value in (
            (0x6082, 10),
            (0x2013, 1000),
            (0x2018, 1000),
            (objects.PROFILE_ACCELERATION, 100_000),
        ):
            write(module, profile, Address(index(base)), value, now)
        write(module, profile, Address(index(objects.MODE)), 3, now)
        mappings = ((objects.STATUSWORD, 16),), ((objects.POSITION, 32), (objects.VELOCITY, 32))
        for number, entries in enumerate(mappings, start=1):
            mapped = tuple(MappedObject(index(base), 0, bits) for base, bits in entries)
            types = tuple(profile.objects[Address(entry.index)].type for entry in mapped)
            configuration = PdoConfiguration(
                direction=Direction.TRANSMIT,
                number=profile.layout.pdo_number(number, axis),
                cob_id=0x180 + 0x100 * (2 * axis + number - 1) % 0x400 + id_of(module),
                mapping=PdoMapping(mapped, types),
                transmission_type=0xFF,
                inhibit_time_100us=PERIOD_100US,
                event_timer_ms=10,
                enabled=True,
            )
            for step in remap_steps(configuration):
                write(module, profile, step.address, step.value, now)
        for word in (6, 7, 15):
            write(module, profile, Address(index(objects.CONTROLWORD)), word, now)
        write(module, profile, Address(index(objects.TARGET_VELOCITY)), 20_000, now)


async def share_of_a_core(seconds: float) -> float:
    """CPU time of this process over wall time, in per cent."""
    wall, cpu = time.perf_counter(), time.process_time()
    await asyncio.sleep(seconds)
    return 100 * (time.process_time() - cpu) / (time.perf_counter() - wall)


async def measure(modules: int, seconds: float) -> tuple[float, float, float]:
    """Per cent of a core while all idle and while all turn, and the frames/s of the latter."""
    profile = Catalog.load().profile("TMCM-3216")
    wire = MemoryWire()
    async with Station(tuple(range(1, modules + 1)), profile, wire=wire, axes=(ENDLESS,) * 3) as station:
        idle = await share_of_a_core(seconds)
        frames = 0

        def count(_sender: str | None, _frame: Frame) -> None:
            nonlocal frames
            frames += 1

        for node_id in range(1, modules + 1):
            station.node(node_id).apply(lambda module, now: set_turning(module, now, profile))
        start = Frame(0, encode(NmtCommand.START, 0))
        wire.inject(start)
        await asyncio.sleep(SETTLING)
        end = wire.tap(count)
        turning = await share_of_a_core(seconds)
        end()
    return idle, turning, frames / seconds


def run(rounds: int, seconds: float) -> list[Row]:
    """See `bench.parts.Part`."""
    idle, turning, rate = zip(*(asyncio.run(measure(MODULES, seconds)) for _ in range(rounds)), strict=True)
    axes = 3 * MODULES
    return [
        Row.alone(f"{MODULES} simulated modules, idle", "% of a core", idle),
        Row.alone(f"the same, {axes} axes turning", "% of a core", turning),
        Row.alone("frames that they send then", "1/s", rate),
    ]


if __name__ == "__main__":
    sys.exit(main(("simulated_modules",)))
