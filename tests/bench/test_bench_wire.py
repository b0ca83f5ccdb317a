"""The benchmark's wire behaves like a raw CAN socket to python-can and to our own link."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import can

from bench.wire import CAN_FRAME, CHANNEL, as_socketcan, pack, pair
from drivers.bus.frame import Frame
from drivers.bus.pythoncan import PythonCanBus


def test_python_can_reads_and_writes_it():
    near, far = pair()
    with as_socketcan(near), can.Bus(channel=CHANNEL, interface="socketcan") as bus, far:
        far.send(pack(0x181, b"\x01\x02"))
        message = bus.recv(5)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (0x181, b"\x01\x02")
        bus.send(can.Message(arbitration_id=0x601, data=b"\x40", is_extended_id=False))
        assert CAN_FRAME.unpack(far.recv(16)) == (0x601, 1, b"\x40".ljust(8, b"\0"))


async def test_our_bus_reads_and_writes_it():
    near, far = pair()
    heard: asyncio.Queue[Frame] = asyncio.Queue()

    def keep(frames: Sequence[Frame]) -> None:
        for frame in frames:
            heard.put_nowait(frame)

    with as_socketcan(near), far:
        bus = PythonCanBus("socketcan", CHANNEL)
        end = bus.subscribe(keep)
        await bus.open()
        try:
            far.send(pack(0x181, b"\x01\x02"))
            frame = await asyncio.wait_for(heard.get(), 5)
            assert (frame.cob_id, frame.data) == (0x181, b"\x01\x02")
            bus.send(Frame(0x601, b"\x40"))
            assert CAN_FRAME.unpack(far.recv(16)) == (0x601, 1, b"\x40".ljust(8, b"\0"))
        finally:
            end()
            await bus.close()


def test_a_full_end_refuses_instead_of_blocking():
    near, far = pair()
    sent = 0
    with near, far:
        try:
            while sent < 1_000_000:
                far.send(pack(0x181, b""))
                sent += 1
        except BlockingIOError:
            pass
        for _ in range(sent):
            near.recv(16)
    assert 100 < sent < 1_000_000
