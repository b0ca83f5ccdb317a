"""The sender's process on a real SocketCAN link, beside whoever else has it open."""

from __future__ import annotations

import asyncio
import pathlib
import struct

import can
import pytest

from drivers.bus.base import Beside
from drivers.cyclic.process import ProcessSender
from drivers.cyclic.sender import CyclePlan, Phase, Track

pytestmark = [pytest.mark.socketcan, pytest.mark.process, pytest.mark.timeout(120)]

CHANNEL = "vcan0"
SYNC, RPDO = 0x80, 0x500

if not pathlib.Path(f"/sys/class/net/{CHANNEL}").exists():
    pytest.skip(f"there is no {CHANNEL} here", allow_module_level=True)


async def test_each_set_point_is_on_the_link_before_its_sync() -> None:
    rows = [(float(number),) for number in range(1, 41)]
    news = asyncio.Event()
    plan = CyclePlan(0.02, (0.0,), (Track(RPDO, b"\x0f\x00", 5.0),), 4, 100)
    with can.Bus(interface="socketcan", channel=CHANNEL) as listener:
        sender = ProcessSender(plan, Beside("socketcan", CHANNEL), news.set)
        await sender.open()
        sender.feed(rows)
        sender.finish()
        sender.go()
        while sender.report.phase in (Phase.READY, Phase.RUNNING):
            news.clear()
            await news.wait()
        report = sender.report
        await sender.close()
        seen: list[can.Message] = []
        while (message := listener.recv(0)) is not None:
            seen.append(message)
    assert (report.phase, report.why) == (Phase.STANDING, "")
    targets = [struct.unpack_from("<i", m.data, 2)[0] for m in seen if m.arbitration_id == RPDO]
    assert targets == [row[0] for row in rows]
    assert [m.arbitration_id for m in seen] == [RPDO, SYNC] * len(rows)
    assert report.cycles == len(rows)
