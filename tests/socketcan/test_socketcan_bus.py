"""What a real kernel does to a `PythonCanBus`: link down and up, unplugging, full queues, error frames."""

from __future__ import annotations

import asyncio
import os
import pathlib
import socket
import struct
import subprocess
from collections.abc import AsyncIterator, Callable, Iterator, Sequence

import pytest
import uvloop

from drivers.bus.base import Bus, BusState
from drivers.bus.frame import Frame
from drivers.bus.pythoncan import PythonCanBus
from drivers.bus.reader import DescriptorReader
from drivers.errors import BusDown, BusOverflow

pytestmark = pytest.mark.socketcan

CHANNEL = "vcan0"
ERROR_FLAG = 0x20000000

if not pathlib.Path(f"/sys/class/net/{CHANNEL}").exists():
    pytest.skip(f"there is no {CHANNEL} here", allow_module_level=True)
if os.geteuid() != 0:
    pytest.skip(f"only root may take {CHANNEL} down and up", allow_module_level=True)


class Listener:
    """Keeps what a bus hands over, and wakes who waits for it."""

    def __init__(self, bus: Bus) -> None:
        self.batches: list[list[Frame]] = []
        self.states: list[tuple[BusState, str]] = []
        self._news = asyncio.Event()
        bus.subscribe(self._on_frames, self._on_state)

    @property
    def frames(self) -> list[Frame]:
        return [frame._replace(timestamp=0.0) for batch in self.batches for frame in batch]

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(20):
            while not condition():
                self._news.clear()
                await self._news.wait()

    async def count(self, number: int) -> list[Frame]:
        await self.until(lambda: len(self.frames) >= number)
        return self.frames

    async def state(self, state: BusState) -> str:
        """Wait until the last reported state is this one; returns the sentence."""
        await self.until(lambda: bool(self.states) and self.states[-1][0] is state)
        return self.states[-1][1]

    def _on_frames(self, batch: Sequence[Frame]) -> None:
        self.batches.append(list(batch))
        self._news.set()

    def _on_state(self, state: BusState, reason: str) -> None:
        self.states.append((state, reason))
        self._news.set()


def link(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True, capture_output=True, timeout=10)


@pytest.fixture
def link_is_restored() -> Iterator[None]:
    """Bring the link up again, whatever the test did."""
    yield
    link("set", CHANNEL, "up")


@pytest.fixture
async def bus() -> AsyncIterator[PythonCanBus]:
    bus = PythonCanBus("socketcan", CHANNEL)
    await bus.open()
    yield bus
    await bus.close()


@pytest.fixture
def raw() -> Iterator[socket.socket]:
    """A socket of someone else on the same bus."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind((CHANNEL,))
        raw.settimeout(10)
        yield raw


def put(raw: socket.socket, identifier: int, data: bytes = b"") -> None:
    raw.send(struct.pack("=IB3x8s", identifier, len(data), data))


def put_error(raw: socket.socket, error_class: int, data: bytes = bytes(8)) -> None:
    put(raw, ERROR_FLAG | error_class, data)


async def test_frames_travel_both_ways(bus: PythonCanBus, raw: socket.socket) -> None:
    heard = Listener(bus)
    bus.send(Frame(0x601, b"\x40\x41\x60"))
    bus.send(Frame(0x1FFFFFFF, b"\x01", extended=True))
    bus.send(Frame(0x701, remote=True))
    assert struct.unpack("=IB3x8s", raw.recv(16)) == (0x601, 3, b"\x40\x41\x60\0\0\0\0\0")
    assert struct.unpack("=IB3x8s", raw.recv(16))[0] == 0x9FFFFFFF
    assert struct.unpack("=IB3x8s", raw.recv(16))[0] == 0x40000701
    put(raw, 0x701, b"\x05")
    put(raw, 0x080)
    put(raw, 0x80000000 | 0x12345678, bytes(range(8)))
    put(raw, 0x40000000 | 0x701)
    assert await heard.count(4) == [
        Frame(0x701, b"\x05"),
        Frame(0x080),
        Frame(0x12345678, bytes(range(8)), extended=True),
        Frame(0x701, remote=True),
    ]
    assert isinstance(bus._reader, DescriptorReader)


async def test_a_burst_is_handed_over_in_bounded_batches(bus: PythonCanBus, raw: socket.socket) -> None:
    heard = Listener(bus)
    for number in range(300):
        put(raw, 0x181, number.to_bytes(2, "little"))
    frames = await heard.count(300)
    assert [int.from_bytes(frame.data, "little") for frame in frames] == list(range(300))
    assert [len(batch) for batch in heard.batches] == [256, 44]


@pytest.mark.usefixtures("link_is_restored")
async def test_link_down_is_seen_and_link_up_brings_the_bus_back(bus: PythonCanBus) -> None:
    heard = Listener(bus)
    link("set", CHANNEL, "down")
    assert "errno" in await heard.state(BusState.DOWN)
    with pytest.raises(BusDown, match="is down"):
        bus.send(Frame(0x000))
    link("set", CHANNEL, "up")
    await heard.state(BusState.ACTIVE)
    assert [state for state, _ in heard.states] == [BusState.DOWN, BusState.ACTIVE]
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind((CHANNEL,))
        put(raw, 0x701, b"\x05")
    assert await heard.count(1) == [Frame(0x701, b"\x05")]
    assert bus.counters.reopened == 1


@pytest.mark.usefixtures("link_is_restored")
def test_link_down_and_up_are_seen_under_uvloop_as_well() -> None:
    async def down_and_up() -> list[BusState]:
        bus = PythonCanBus("socketcan", CHANNEL)
        await bus.open()
        heard = Listener(bus)
        for _ in range(2):
            link("set", CHANNEL, "down")
            await heard.state(BusState.DOWN)
            link("set", CHANNEL, "up")
            await heard.state(BusState.ACTIVE)
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
            raw.bind((CHANNEL,))
            put(raw, 0x701, b"\x05")
        await heard.count(1)
        await bus.close()
        return [state for state, _ in heard.states]

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        states = runner.run(down_and_up())
    assert states == [BusState.DOWN, BusState.ACTIVE] * 2 + [BusState.CLOSED]


@pytest.mark.usefixtures("link_is_restored")
async def test_a_link_that_is_down_does_not_open() -> None:
    link("set", CHANNEL, "down")
    bus = PythonCanBus("socketcan", CHANNEL)
    with pytest.raises(BusDown, match="the link is down") as refusal:
        await bus.open()
    assert "ip link set vcan0 up" in refusal.value.hint
    assert bus.state is BusState.CLOSED


async def test_an_adapter_pulled_out_and_plugged_in_again_works_again() -> None:
    link("add", "vcan7", "type", "vcan")
    try:
        link("set", "vcan7", "up")
        bus = PythonCanBus("socketcan", "vcan7")
        await bus.open()
        heard = Listener(bus)
        link("del", "vcan7")
        await heard.state(BusState.DOWN)
        link("add", "vcan7", "type", "vcan")
        link("set", "vcan7", "up")
        await heard.state(BusState.ACTIVE)
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
            raw.bind(("vcan7",))
            put(raw, 0x701, b"\x05")
        assert await heard.count(1) == [Frame(0x701, b"\x05")]
        await bus.close()
    finally:
        link("del", "vcan7")


@pytest.fixture
def slow_link() -> Iterator[None]:
    """A link that lets four frames wait, each for a while, and answers ENOBUFS to the fifth."""
    command = ["tc", "qdisc", "add", "dev", CHANNEL, "root", "netem", "delay", "50ms", "limit", "4"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=10)
    if done.returncode != 0:
        pytest.skip(f"no tc netem here: {done.stderr.strip()}")
    yield
    subprocess.run(
        ["tc", "qdisc", "del", "dev", CHANNEL, "root"], check=True, capture_output=True, timeout=10
    )


@pytest.mark.usefixtures("slow_link")
async def test_a_full_queue_makes_frames_wait_and_urgent_ones_overtake(bus: PythonCanBus) -> None:
    listener = PythonCanBus("socketcan", CHANNEL)
    await listener.open()
    heard = Listener(listener)
    for number in range(6):
        bus.send(Frame(0x201, bytes([number])))
    assert bus.counters.sent == 4
    bus.send(Frame(0x000, b"\x02\x00"), urgent=True)
    frames = await heard.count(7)
    await listener.close()
    assert [frame.data[0] for frame in frames if frame.cob_id == 0x201] == list(range(6))
    assert frames.index(Frame(0x000, b"\x02\x00")) == 4
    assert bus.state is BusState.ACTIVE


@pytest.mark.usefixtures("slow_link")
async def test_an_overfull_queue_is_said_and_leaves_room_for_a_stop(bus: PythonCanBus) -> None:
    def flood() -> None:
        while True:
            bus.send(Frame(0x201))

    with pytest.raises(BusOverflow, match="nobody takes our frames"):
        flood()
    bus.send(Frame(0x000, b"\x02\x00"), urgent=True)


async def test_what_the_kernel_had_to_drop_is_counted(bus: PythonCanBus, raw: socket.socket) -> None:
    heard = Listener(bus)
    for _ in range(20_000):  # more than any receive buffer holds, and we don't read meanwhile
        put(raw, 0x181)
    await heard.until(lambda: bus.counters.received + bus.counters.dropped == 20_000)
    assert bus.counters.dropped > 0


async def test_error_frames_tell_of_each_state_of_the_controller(
    bus: PythonCanBus, raw: socket.socket
) -> None:
    heard = Listener(bus)
    put_error(raw, 0x004, b"\x00\x08\x00\x00\x00\x00\x60\x00")
    await heard.state(BusState.WARNING)
    put_error(raw, 0x004, b"\x00\x20\x00\x00\x00\x00\x80\x00")
    await heard.state(BusState.PASSIVE)
    bus.send(Frame(0x201))
    put_error(raw, 0x040)
    assert "bus-off" in await heard.state(BusState.BUS_OFF)
    with pytest.raises(BusDown, match="bus-off"):
        bus.send(Frame(0x201))
    put_error(raw, 0x100)
    await heard.state(BusState.ACTIVE)
    bus.send(Frame(0x201))
    assert all(frame.error for frame in heard.frames)
    assert [frame.cob_id for frame in heard.frames] == [0x004, 0x004, 0x040, 0x100]


async def test_an_error_frame_that_looks_like_an_emergency_is_none(
    bus: PythonCanBus, raw: socket.socket
) -> None:
    heard = Listener(bus)
    put_error(raw, 0x081)
    (frame,) = await heard.count(1)
    assert frame.error
    assert bus.state is BusState.ACTIVE


async def test_closing_leaves_no_socket_behind(raw: socket.socket) -> None:
    bus = PythonCanBus("socketcan", CHANNEL)
    for _ in range(3):
        await bus.open()
        bus.send(Frame(0x000))
        await bus.close()
    assert [struct.unpack("=IB3x8s", raw.recv(16))[0] for _ in range(3)] == [0, 0, 0]
