"""What the log says of the bus: each emergency with cause and remedy, each state of a node once."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest
from structlog.testing import capture_logs

from app.events.journal import KINDS, keep_journal
from drivers.cia301.emcy import Emergency
from drivers.devices.catalog import Catalog
from drivers.master.seen.emergencies import EmergencyLog
from drivers.master.seen.events import EventHub


@pytest.fixture
async def hub() -> AsyncIterator[EventHub]:
    hub = EventHub()
    task = asyncio.create_task(keep_journal(hub.subscribe(kinds=KINDS)))
    yield hub
    hub.close()
    await task


async def settle() -> None:
    for _ in range(3):
        await asyncio.sleep(0)


async def test_an_emergency_is_logged_with_its_cause_and_remedy(hub: EventHub) -> None:
    record = EmergencyLog(1, Catalog.load().profile("TMCM-3216").emergencies).record(
        Emergency(0x8611, 0x20, bytes((0, 2, 0, 0, 0)))
    )
    with capture_logs() as lines:
        hub.publish("emergency", node=1, axis=2, data={"record": record})
        await settle()
    (line,) = lines
    assert (line["log_level"], line["node"], line["axis"], line["code"]) == ("warning", 1, 2, "8611h")
    assert line["cause"] == record.cause
    assert line["remedy"] == record.remedy


async def test_a_latched_stop_and_its_reset_are_logged_and_statuses_are_not(hub: EventHub) -> None:
    with capture_logs() as lines:
        hub.publish("stop", data={"latched": True, "reason": "smoke"})
        hub.publish("axis", node=1, axis=0, data={"status": object()})
        hub.publish("stop", data={"latched": False, "reason": ""})
        await settle()
    assert [line["event"] for line in lines] == ["everything is told to stop", "the stop is reset"]
    assert lines[0]["reason"] == "smoke"
