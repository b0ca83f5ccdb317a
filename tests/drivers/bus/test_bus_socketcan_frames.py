"""Our own writing of `struct can_frame`, on a pair of sockets that carries them as a raw CAN socket does."""

from __future__ import annotations

import asyncio

import can
import pytest

from bench.wire import CHANNEL, as_socketcan, pair
from drivers.bus.base import BusState
from drivers.bus.frame import Frame
from drivers.bus.pythoncan import PythonCanBus

FRAMES = [
    Frame(0x601, bytes.fromhex("4064600000000000")),
    Frame(0x000, b"\x81\x05"),
    Frame(0x080),
    Frame(0x1ABCDEF0, b"\x01\x02\x03", extended=True),
    Frame(0x701, remote=True),
]


@pytest.mark.parametrize("frame", FRAMES, ids=str)
async def test_python_can_reads_what_we_write(frame: Frame) -> None:
    near, far = pair()
    with as_socketcan(near):
        bus = PythonCanBus("socketcan", CHANNEL)
        await bus.open()
    with as_socketcan(far), can.Bus(channel=CHANNEL, interface="socketcan") as other:
        bus.send(frame)
        await bus.close()
        message = other.recv(1)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (frame.cob_id, frame.data)
    assert (message.is_extended_id, message.is_remote_frame) == (frame.extended, frame.remote)


async def test_a_full_socket_lets_frames_wait_until_there_is_room() -> None:
    near, far = pair()
    with as_socketcan(near), far:
        bus = PythonCanBus("socketcan", CHANNEL)
        await bus.open()
        sent = 0
        while bus.counters.sent == sent:
            bus.send(FRAMES[0])
            sent += 1
        assert bus.state is BusState.ACTIVE
        async with asyncio.timeout(5):
            for _ in range(sent):  # the last of them is the one that waited
                await asyncio.get_running_loop().sock_recv(far, 72)
        assert bus.counters.sent == sent
        await bus.close()
