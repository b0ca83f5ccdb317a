"""Several simulated modules on one wire, and their fault panels, on a virtual clock."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import AsyncIterator, Sequence
from typing import Any

import pytest

from drivers.bus.base import Bus, BusState
from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryWire
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import BadValue, NotReady, UnknownNode
from drivers.sim.panel import COMMANDS, ModulePanel
from drivers.sim.snapshot import WatchSnapshot
from drivers.sim.station import Listen, Station
from drivers.sim.storage import MemoryStore

pytestmark = pytest.mark.looptime

PROFILE = Catalog.load().profile("TMCM-3216")


class Observer:
    """Another node on the wire: sends, and keeps what it hears."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.heard: list[tuple[float, str]] = []

    def on_frames(self, frames: Sequence[Frame]) -> None:
        now = asyncio.get_running_loop().time()
        self.heard += [(now, f"{frame.cob_id:03X}#{frame.data.hex()}") for frame in frames]

    async def send(self, cob_id: int, data: str) -> list[str]:
        """Send, wait a little, and give what was heard meanwhile."""
        self.heard.clear()
        self.bus.send(Frame(cob_id, bytes.fromhex(data)))
        return await self.listen()

    async def listen(self, seconds: float = 0.01) -> list[str]:
        await asyncio.sleep(seconds)
        frames = [frame for _, frame in self.heard]
        self.heard.clear()
        return frames


@pytest.fixture
async def station() -> AsyncIterator[Station]:
    async with Station((1, 2), PROFILE, wire=MemoryWire()) as station:
        yield station


@pytest.fixture
async def observer(station: Station) -> AsyncIterator[Observer]:
    observer = Observer(station.wire.port("observer"))
    await observer.bus.open()
    observer.bus.subscribe(observer.on_frames)
    await asyncio.sleep(0.01)
    yield observer
    await observer.bus.close()


@pytest.fixture
def panel(station: Station, observer: Observer) -> ModulePanel:
    return station.panel(1)


READ_TYPE = "4000100000000000"
TYPE_OF_1 = "581#430010009201fcff"


async def enable(observer: Observer, *, speed: int) -> None:
    """Axis 0 of node 1 in profile velocity, at a speed."""
    for request in (
        "2f60600003000000",
        "2383600000e80300",
        "2b40600006000000",
        "2b40600007000000",
        "2b4060000f000000",
        f"23ff6000{speed.to_bytes(4, 'little', signed=True).hex()}",
    ):
        (answer,) = await observer.send(0x601, request)
        assert answer.startswith("581#60"), answer


# --- the station ---


async def test_its_modules_answer_each_for_itself(station: Station, observer: Observer) -> None:
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1]
    assert await observer.send(0x602, READ_TYPE) == ["582#430010009201fcff"]
    assert await observer.send(0x602, "4018100400000000") == ["582#4318100402000000"]
    assert list(station.nodes) == [1, 2]


async def test_a_module_can_be_removed_and_another_added(station: Station, observer: Observer) -> None:
    station.panel(1).drop_frames(0x582)
    await station.remove(1)
    assert await observer.send(0x601, READ_TYPE) == []
    assert await observer.send(0x602, READ_TYPE) == ["582#430010009201fcff"], "its wire faults went with it"
    assert [port.name for port in station.wire.ports] == ["node 2", "observer"]
    await station.add(7)
    assert await observer.listen() == ["707#00"]
    with pytest.raises(UnknownNode, match="no module with node ID 1") as unknown:
        station.panel(1)
    assert unknown.value.hint == "Simulated are: 2, 7."


@pytest.mark.parametrize("ids", [(0,), (128,), (1, 2, 1)])
def test_node_ids_are_checked_at_once(ids: tuple[int, ...]) -> None:
    with pytest.raises(BadValue):
        Station(ids, PROFILE)


async def test_a_node_id_that_is_taken_is_refused(station: Station) -> None:
    with pytest.raises(BadValue, match="node ID 2 is there already"):
        await station.add(2)
    assert list(station.nodes) == [1, 2]


async def test_each_module_has_the_memory_that_it_is_given() -> None:
    stores = {1: MemoryStore(), 2: MemoryStore()}
    stores[2].save({Address(0x2005): 3})
    async with Station((1, 2), PROFILE, store=stores.__getitem__) as station:
        values = [node.module.dictionary.stored(Address(0x2005)) for node in station.nodes.values()]
    assert values == [0, 3]


async def test_a_station_leaves_nothing_behind() -> None:
    wire = MemoryWire()
    async with Station((1, 2, 3), PROFILE, wire=wire) as station:
        assert len(wire.ports) == 3
    assert wire.ports == ()
    assert not station.nodes


async def test_it_undoes_what_it_began_when_it_can_not_start() -> None:
    wire = MemoryWire()
    broken = Station((1, 2), PROFILE, wire=wire, store={1: MemoryStore()}.__getitem__)
    with pytest.raises(KeyError):
        await broken.__aenter__()
    assert wire.ports == ()


async def test_twenty_idle_modules_wake_nobody_up(monkeypatch: pytest.MonkeyPatch) -> None:
    async with Station(range(1, 21), PROFILE) as station:
        await asyncio.sleep(1.0)
        loop = asyncio.get_running_loop()
        timers: list[float] = []
        original = loop.call_at

        def counted(when: float, *arguments: Any, **keywords: Any):
            timers.append(when)
            return original(when, *arguments, **keywords)

        monkeypatch.setattr(loop, "call_at", counted)
        await asyncio.sleep(3600.0)
        assert timers == [3601.0], "the only timer in an hour is this test's own"
        for node in station.nodes.values():
            assert node.module.next_wakeup(loop.time()) is None


# --- mechanics and electrics ---


async def test_a_pressed_switch_shows_and_stops(panel: ModulePanel, observer: Observer) -> None:
    await enable(observer, speed=10_000)
    panel.press_switch(0, "positive")
    (emergency,) = await observer.listen()
    assert (emergency[:8], emergency[10:]) == ("081#01ff", "0300000000")
    seen = panel.state().axes[0]
    assert seen.pressed == seen.switches == ("positive",)
    assert (seen.state, seen.moving) == (PowerState.FAULT, False)
    panel.release_switch(0, "positive")
    assert panel.state().axes[0].switches == ()


async def test_a_blocked_axis_stands_while_the_motor_turns(panel: ModulePanel, observer: Observer) -> None:
    await enable(observer, speed=10_000)
    await asyncio.sleep(0.5)
    panel.block(0)
    before = panel.state().axes[0]
    await asyncio.sleep(0.5)
    after = panel.state().axes[0]
    assert before.blocked
    assert after.place == before.place
    assert after.position > before.position
    panel.unblock(0)
    await asyncio.sleep(0.5)
    assert panel.state().axes[0].place > after.place


async def test_the_supply_can_be_cut_for_one_axis_or_all(panel: ModulePanel, observer: Observer) -> None:
    panel.cut_supply(2)
    assert [axis.supply_voltage for axis in panel.state().axes] == [24.0, 24.0, 0.0]
    panel.cut_supply()
    frames = await observer.listen()
    assert [frame[4:8] + frame[12:14] for frame in frames] == ["00ff02", "00ff00", "00ff01"]
    panel.restore_supply()
    assert {axis.supply_voltage for axis in panel.state().axes} == {24.0}
    panel.set_supply(9.5, axis=1)
    assert panel.state().axes[1].supply_voltage == 9.5


@pytest.mark.parametrize(
    ("command", "arguments", "emergency"),
    [
        ("set_temperature", {"axis": 0, "celsius": 130.0}, "1043"),
        ("short", {"axis": 0, "bridge": "a"}, "1223"),
        ("short", {"axis": 0, "bridge": "high"}, "1023"),
        ("open_load", {"axis": 0, "bridge": "b"}, "0010"),
        ("set_shutdown_input", {"active": True}, "4154"),
        ("report_error", {"code": 0x8110, "detail": 2}, "1081"),
    ],
)
async def test_a_trouble_is_reported(
    panel: ModulePanel, observer: Observer, command: str, arguments: dict, emergency: str
) -> None:
    panel.perform(command, arguments)
    frames = await observer.listen()
    assert frames
    assert {frame[:8] for frame in frames} == {f"081#{emergency}"}


async def test_only_a_moving_motor_can_be_stalled(panel: ModulePanel, observer: Observer) -> None:
    with pytest.raises(NotReady, match="axis 0 stands"):
        panel.stall(0)
    await enable(observer, speed=10_000)
    panel.stall(0)
    assert (await observer.listen())[0].startswith("081#3032")


async def test_inputs_read_what_they_are_given(panel: ModulePanel, observer: Observer) -> None:
    panel.set_digital_input(3, True)
    panel.set_analog_input(1, 1234)
    assert await observer.send(0x601, "4002270000000000") == ["581#4302270000000800"]
    assert await observer.send(0x601, "400e270200000000") == ["581#430e2702d2040000"]
    seen = panel.state()
    assert seen.digital_levels == (False, False, False, True)
    assert seen.digital_outputs == (False,) * 4
    assert seen.analog_inputs == (0, 1234)


async def test_an_axis_that_is_not_there_is_refused(panel: ModulePanel) -> None:
    with pytest.raises(BadValue, match="axis must be from 0 to 2, not 3"):
        panel.block(3)


# --- power and connection ---


async def test_a_power_cycle_boots_up_and_forgets(panel: ModulePanel, observer: Observer) -> None:
    await observer.send(0x601, "2f05200003000000")
    panel.power_cycle()
    assert await observer.listen() == ["701#00"]
    assert await observer.send(0x601, "4005200000000000") == ["581#4305200000000000"]


async def test_power_off_and_on(panel: ModulePanel, observer: Observer) -> None:
    panel.power_off()
    assert not panel.state().powered
    assert await observer.send(0x601, READ_TYPE) == []
    panel.power_on()
    panel.power_on()
    assert await observer.listen() == ["701#00"], "power on while on does nothing"


async def test_bus_off_and_back(panel: ModulePanel, observer: Observer) -> None:
    panel.bus_off()
    assert panel.state().bus is BusState.BUS_OFF
    assert await observer.send(0x601, READ_TYPE) == []
    panel.recover_bus()
    assert await observer.listen() == ["081#40811100ff000000"]
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1]


async def test_a_cable_off_and_back(panel: ModulePanel, observer: Observer) -> None:
    panel.unplug()
    assert panel.state().bus is BusState.DOWN
    assert await observer.send(0x601, READ_TYPE) == []
    panel.plug()
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1]


@pytest.mark.parametrize("command", ["set_silent", "set_deaf", "set_sdo_mute"])
async def test_a_broken_transmitter_or_receiver(panel: ModulePanel, observer: Observer, command: str) -> None:
    panel.perform(command, {"active": True})
    assert await observer.send(0x601, READ_TYPE) == []
    panel.perform(command, {"active": False})
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1]


async def test_sdos_are_answered_late(panel: ModulePanel, observer: Observer) -> None:
    panel.set_sdo_delay(0.7)
    assert await observer.send(0x601, READ_TYPE) == []
    assert await observer.listen(0.68) == []
    assert await observer.listen(0.02) == [TYPE_OF_1]


async def test_a_boot_up_can_be_left_out(panel: ModulePanel, observer: Observer) -> None:
    panel.set_no_boot_up(True)
    panel.power_cycle()
    assert await observer.listen() == []
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1]


# --- frames on the wire ---


async def test_frames_are_dropped_and_counted(panel: ModulePanel, observer: Observer) -> None:
    panel.drop_frames(0x581, count=2)
    answers = [await observer.send(0x601, READ_TYPE) for _ in range(3)]
    assert answers == [[], [], [TYPE_OF_1]]
    (fault,) = panel.state().wire_faults
    assert (fault.kind, fault.cob_id, fault.hits, fault.remaining) == ("drop", 0x581, 2, 0)


async def test_frames_are_delayed_doubled_changed_and_cut(panel: ModulePanel, observer: Observer) -> None:
    panel.delay_frames(0x581, seconds=0.5, count=1)
    assert await observer.send(0x601, READ_TYPE) == []
    assert await observer.listen(0.5) == [TYPE_OF_1]
    panel.duplicate_frames(0x581, count=1)
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1] * 2
    panel.corrupt_frames(0x581, byte=7, bits=0x0F, count=1)
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1[:-1] + "0"]
    panel.truncate_frames(0x581, length=4, count=1)
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1[:12]]
    assert [fault.hits for fault in panel.state().wire_faults] == [1, 1, 1, 1]


async def test_frames_without_the_byte_pass(panel: ModulePanel, observer: Observer) -> None:
    panel.corrupt_frames(0x701, byte=1)
    panel.truncate_frames(0x701, length=1)
    panel.power_cycle()
    assert await observer.listen() == ["701#00"]
    assert [fault.hits for fault in panel.state().wire_faults] == [0, 0]


async def test_wire_faults_are_bounded_and_spent_ones_make_room(
    panel: ModulePanel, observer: Observer
) -> None:
    panel.drop_frames(0x581, count=1)
    await observer.send(0x601, READ_TYPE)
    for _ in range(64):
        panel.drop_frames(0x700)
    with pytest.raises(BadValue, match="64 wire faults are on already"):
        panel.drop_frames(0x581)
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1]
    panel.end_wire_faults()
    assert panel.state().wire_faults == ()


# --- all at once ---


EVERYTHING = [
    ("press_switch", {"axis": 1, "switch": "home"}),
    ("block", {"axis": 2}),
    ("set_load", {"axis": 0, "share": 0.9}),
    ("set_supply", {"volts": 5}),
    ("set_temperature", {"axis": 0, "celsius": 160}),
    ("short", {"axis": 0, "bridge": "b"}),
    ("open_load", {"axis": 1, "bridge": "a"}),
    ("set_shutdown_input", {"active": True}),
    ("set_digital_input", {"terminal": 0, "level": True}),
    ("set_analog_input", {"terminal": 0, "value": 4095}),
    ("set_silent", {"active": True}),
    ("set_deaf", {"active": True}),
    ("set_no_boot_up", {"active": True}),
    ("set_sdo_delay", {"seconds": 2.0}),
    ("set_sdo_mute", {"active": True}),
    ("drop_frames", {"cob_id": "0x581"}),
]


@pytest.mark.parametrize("last", ["power_off", "bus_off", "unplug", "power_cycle"])
async def test_clear_undoes_everything(panel: ModulePanel, observer: Observer, last: str) -> None:
    fresh = panel.state()
    for command, arguments in [*EVERYTHING, (last, {})]:
        panel.perform(command, arguments)
        assert dataclasses.replace(panel.state()) != fresh
    panel.clear()
    await observer.listen()
    panel.power_cycle()
    assert panel.state() == fresh
    assert (await observer.listen())[-1] == "701#00"
    assert await observer.send(0x601, READ_TYPE) == [TYPE_OF_1]


async def test_the_watch_over_the_master_is_shown_with_its_times(
    panel: ModulePanel, observer: Observer
) -> None:
    assert panel.state().watch == WatchSnapshot(None, None, None)
    await observer.send(0x601, "23 16 10 01 C8 00 7F 00")  # 1016h:1: node 127, 200 ms
    assert panel.state().watch == WatchSnapshot(127, None, None)
    await observer.send(0x77F, "05")
    armed = panel.state()
    assert armed.watch.heard_at is not None
    assert armed.watch.heard_at <= armed.clock
    await asyncio.sleep(0.5)
    expired = panel.state()
    assert expired.watch.heard_at == armed.watch.heard_at
    assert expired.watch.lost_at is not None
    assert armed.watch.heard_at + 0.2 <= expired.watch.lost_at <= expired.clock


async def test_a_snapshot_does_not_change_afterwards(panel: ModulePanel) -> None:
    before = panel.state()
    panel.block(0)
    assert not before.axes[0].blocked
    with pytest.raises(dataclasses.FrozenInstanceError):
        before.powered = False  # pyright: ignore[reportAttributeAccessIssue] - which is frozen


async def test_the_typed_methods_check_what_they_are_given(panel: ModulePanel) -> None:
    with pytest.raises(BadValue, match="one of negative, positive, home"):
        panel.press_switch(0, "left")  # pyright: ignore[reportArgumentType] - no switch
    assert COMMANDS["press_switch"].summary == "Press a switch by hand."
    assert panel.state().axes[0].pressed == ()


def test_where_to_listen_has_a_safe_default() -> None:
    assert Listen() == ("127.0.0.1", 0)
