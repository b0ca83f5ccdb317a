"""openapi/events.md against what the service sends: every kind, every field, in both directions."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import pytest
from api_bench import Bench, EventClient, ServerEvent
from repository import ROOT

from app.events import streams
from drivers.master.seen import events

pytestmark = pytest.mark.looptime

PAGE = (ROOT / "openapi" / "events.md").read_text(encoding="utf-8")
EXAMPLES: dict[str, dict[str, Any]] = {
    kind: json.loads(data)
    for _, kind, data in re.findall(r"```text\n(id: \d+\n)?event: (\w+)\ndata: (.*)\n```", PAGE)
}
KINDS = {"snapshot", "axis", "node", "bus", "emergency", "lease", "motion", "stop", "missed"}


def shape(value: object) -> object:
    """The names of the fields at every depth; of lists the first item stands for all."""
    if isinstance(value, Mapping):
        return {key: shape(item) for key, item in value.items()}
    if isinstance(value, list) and value:
        return [shape(value[0])]
    return None


async def one_of_each(bench: Bench) -> dict[str, ServerEvent]:
    """The first event of each kind, out of all that can happen."""
    hub = bench.service.network.events
    found: dict[str, ServerEvent] = {}
    async with EventClient(bench.app) as slow:
        await slow.next("snapshot")
        for number in range(400):
            hub.publish("bus", data={"state": "active", "reason": str(number)})
        found["missed"] = await slow.next("missed")
    async with EventClient(bench.app) as stream:
        found["snapshot"] = await stream.next("snapshot")
        await bench.enable()
        await bench.move(10_000_000)
        while (event := await stream.next("motion")).data["started"] is None:
            pass
        found["motion"] = event
        bench.module.apply(lambda module, at: module.axes[1].supply(5.0, at))
        found["emergency"] = await stream.next("emergency")
        found["axis"] = await stream.next("axis")
        await bench.post("/leases", {"axes": [{"node": 1, "axis": 2}]})
        found["lease"] = await stream.next("lease")
        await bench.post("/stop", {"reason": "A hand is in the way."})
        found["stop"] = await stream.next("stop")
        bench.master_port.unplug()
        found["bus"] = await stream.next("bus")
        found["node"] = await stream.next("node")
    return found


async def test_the_page_shows_what_the_service_sends(bench: Bench) -> None:
    assert set(EXAMPLES) == KINDS == set(re.findall(r"^### (\w+)$", PAGE, re.MULTILINE))
    sent = await one_of_each(bench)
    for kind, example in EXAMPLES.items():
        wanted, real = shape(example), shape(sent[kind].data)
        if kind == "snapshot":  # the page leaves out what other replies show already
            assert set(example) == set(sent[kind].data)
            assert shape(example["bus"]) == shape(sent[kind].data["bus"])
        elif kind == "axis":
            assert isinstance(real, dict)
            assert wanted == real | {"emergencies": None}
        else:
            assert wanted == real, kind
    times = [event.data["time"] for event in sent.values() if "time" in event.data]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", time) for time in times), times


async def test_changes_have_the_fields_of_the_replies_to_get(bench: Bench) -> None:
    async with EventClient(bench.app) as stream:
        snapshot = (await stream.next("snapshot")).data
        await bench.enable()
        axis = (await stream.next("axis")).data
    assert set(axis) == set(await bench.axis()) | {"time"}
    for path, key in (("/bus", "bus"), ("/stop", "stop")):
        assert shape(snapshot[key]) == shape((await bench.get(path)).json())
    assert shape(snapshot["nodes"]) == shape((await bench.get("/nodes")).json()["nodes"])


def test_the_numbers_on_the_page_are_those_of_the_code() -> None:
    assert streams.PAUSE == 1 / 50
    for words in (
        f"every {streams.KEEP_ALIVE:g} s",
        f"the last {events.HISTORY}",
        f"up to {streams.CAPACITY}",
        f"no byte for {streams.HUNG:g} s",
        "fifty times a second",
        streams.RETRY.decode().strip(),
    ):
        assert words in " ".join(PAGE.split()), words
