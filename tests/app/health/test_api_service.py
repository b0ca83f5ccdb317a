"""The service itself: life, readiness, measurements, the bus, objects, keys, shutdown."""

from __future__ import annotations

import asyncio
import json
import re

import pytest
from api_bench import Bench, EventClient, running
from starlette.types import Message

from app.configuration.configuration import Configuration

pytestmark = pytest.mark.looptime

WRITABLE = Configuration.model_validate({"objects": {"writable": True}})


async def test_it_lives_and_is_ready(bench: Bench) -> None:
    assert (await bench.client.get("/livez")).json() == {"status": "alive"}
    ready = await bench.client.get("/readyz")
    assert (ready.status_code, ready.json()) == (
        200,
        {"ready": True, "reasons": [], "warnings": []},
    )


async def test_without_its_module_it_lives_but_is_not_ready() -> None:
    async with running(powered=False) as bench:
        assert (await bench.client.get("/livez")).status_code == 200
        ready = await bench.client.get("/readyz")
        assert ready.status_code == 503
        assert "absent" in ready.json()["reasons"][0]
        assert (await bench.get("/nodes/1")).json()["state"] == "absent"
        status = await bench.axis()
        assert (status["state"], status["position"], status["age_s"]) == (None, None, None)
        refused = await bench.post("/nodes/1/axes/0/enable")
        assert (refused.status_code, refused.json()["code"]) == (503, "node_away")
        async with bench.module:
            await bench.until_ready()
            assert (await bench.client.get("/readyz")).status_code == 200


async def test_without_its_bus_it_starts_all_the_same_and_keeps_trying() -> None:
    async with running(plugged=False) as bench:
        ready = await bench.client.get("/readyz")
        assert ready.status_code == 503
        assert "bus" in ready.json()["reasons"][0]
        refused = await bench.post("/nodes/1/axes/0/enable")
        assert (refused.status_code, refused.json()["code"]) == (503, "bus_down")
        assert (await bench.client.post("/api/v1/stop")).status_code == 200
        bench.master_port.plug()
        await bench.until_ready()
        assert (await bench.client.get("/readyz")).status_code == 200
        await bench.post("/stop/reset")
        await bench.enable()


async def test_a_bus_that_goes_is_told(bench: Bench) -> None:
    bench.master_port.unplug()
    await bench.until(lambda: not bench.service.network.bus_status().state.can_send)
    assert (await bench.get("/bus")).json()["state"] != "active"
    assert (await bench.client.get("/readyz")).status_code == 503
    refused = await bench.post("/nodes/1/axes/0/enable")
    assert (refused.status_code, refused.json()["code"]) == (503, "bus_down")


async def test_the_bus_counts(bench: Bench) -> None:
    bus = (await bench.get("/bus")).json()
    assert bus["state"] == "active"
    assert bus["counters"]["received"] > 10
    assert bus["counters"]["sent"] > 10


async def test_metrics_are_what_prometheus_reads(bench: Bench) -> None:
    from prometheus_client.parser import text_string_to_metric_families

    await bench.enable()
    await bench.move(300, wait=30)
    response = await bench.client.get("/metrics")
    assert response.headers["content-type"].startswith("text/plain; version=0.0.4")
    samples = {
        (s.name, tuple(sorted(s.labels.items()))): s.value
        for family in text_string_to_metric_families(response.text)
        for s in family.samples
    }
    assert samples["canaxis_bus_up", ()] == 1
    assert samples["canaxis_bus_received_total", ()] > 10
    assert samples["canaxis_node_state", (("node", "1"), ("state", "operational"))] == 1
    assert samples["canaxis_axis_position_steps", (("axis", "0"), ("node", "1"))] == 300
    assert samples["canaxis_operations_started_total", (("kind", "move"),)] == 1
    assert samples["canaxis_node_sdo_completed_total", (("node", "1"),)] > 10
    key = (("operation", "enable_axis"), ("status", "200"))
    assert samples["canaxis_http_request_duration_seconds_count", key] == 1


async def test_problem_types_are_documented_where_their_uri_points(bench: Bench) -> None:
    refused = (await bench.move(1)).json()
    page = await bench.client.get(refused["type"])
    assert page.status_code == 200
    assert page.json()["code"] == refused["code"]
    assert (await bench.client.get("/problems/no-such")).status_code == 404


async def test_the_root_says_where_everything_is(bench: Bench) -> None:
    for link in (await bench.get("")).json()["links"].values():
        if not link.endswith("/events"):
            assert (await bench.client.get(link)).status_code == 200, link


async def test_the_documentation_needs_no_network_but_ours(bench: Bench) -> None:
    page = await bench.client.get("/docs")
    assert page.status_code == 200
    links = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert links
    for link in links:
        assert link.startswith("/"), f"{link} would be fetched from elsewhere"
        assert (await bench.client.get(link)).status_code == 200


async def test_objects_are_read_with_name_and_type(bench: Bench) -> None:
    response = await bench.get("/nodes/1/objects/0x1018/1")
    assert response.status_code == 200
    assert response.json()["value"] == 0x286
    assert response.json()["type"] == "U32"
    name = (await bench.get("/nodes/1/objects/0x1008/0")).json()
    assert name["value"] == "TMCM-3216"
    assert name["meanings"] == []


async def test_flags_and_option_codes_are_read_with_their_meanings(bench: Bench) -> None:
    option = (await bench.get("/nodes/1/objects/0x705A/0")).json()
    assert option["value"] == 2
    assert [meaning["name"] for meaning in option["meanings"]] == ["quick_ramp_and_disable"]
    bench.module.apply(lambda module, now: module.axes[1].open_load("a", now))
    flags = (await bench.get("/nodes/1/objects/0x2302/0")).json()
    assert [meaning["name"] for meaning in flags["meanings"]] == ["open_load_a"]
    assert flags["meanings"][0]["remedy"]


BAD_ADDRESSES = [
    ("0x5FFE/0", 404, "unknown_object"),
    ("0x1018/200", 404, "unknown_object"),
    ("6064/0", 422, "bad_value"),
    ("0x/0", 422, "bad_value"),
    ("0x60640/0", 422, "bad_value"),
    ("0x6064/256", 422, "bad_request"),
    ("0x6064/-1", 422, "bad_request"),
    ("0x6064/x", 422, "bad_request"),
]


async def test_bad_addresses(bench: Bench) -> None:
    for path, status, code in BAD_ADDRESSES:
        response = await bench.get(f"/nodes/1/objects/{path}")
        assert (response.status_code, response.json()["code"]) == (status, code)


async def test_objects_are_not_written_unless_the_settings_allow_it(bench: Bench) -> None:
    response = await bench.put("/nodes/1/objects/0x6081/0", {"value": 5, "confirm": True})
    assert (response.status_code, response.json()["code"]) == (403, "objects_read_only")


async def test_allowed_writes_are_checked_and_guarded() -> None:
    async with running(WRITABLE) as bench:
        await bench.until_ready()
        written = await bench.put("/nodes/1/objects/0x6081/0", {"value": 12345})
        assert written.status_code == 200, written.text
        assert written.json()["value"] == 12345
        for value in (-1, "x", 1.5, True):
            refused = await bench.put("/nodes/1/objects/0x6081/0", {"value": value})
            assert (refused.status_code, refused.json()["code"]) == (422, "bad_value"), value
        guarded = await bench.put("/nodes/1/objects/0x607D/1", {"value": 5})
        assert (guarded.status_code, guarded.json()["code"]) == (409, "guarded_object")
        assert (
            await bench.put("/nodes/1/objects/0x607D/1", {"value": -5, "confirm": True})
        ).status_code == 200
        never = await bench.put("/nodes/1/objects/0x6040/0", {"value": 15, "confirm": True})
        assert (never.status_code, never.json()["code"]) == (409, "guarded_object")


async def test_a_node_that_does_not_answer_is_504_and_says_that_the_outcome_is_unknown(bench: Bench) -> None:
    bench.wire.faults.drop(lambda frame: frame.cob_id == 0x581)
    response = await bench.get("/nodes/1/objects/0x1018/1")
    assert response.status_code == 504
    assert response.json()["code"] == "sdo_timeout"
    assert response.json()["hint"]


async def test_a_command_sent_twice_with_one_key_is_carried_out_once(bench: Bench) -> None:
    await bench.enable()
    body = {"target": 1000, "relative": True, "unit": "steps"}
    key = {"Idempotency-Key": "a-b-c"}
    first = await bench.post("/nodes/1/axes/0/move?wait=30", body, headers=key)
    again = await bench.post("/nodes/1/axes/0/move?wait=30", body, headers=key)
    assert first.status_code == again.status_code == 200
    assert first.json() == again.json()
    assert again.headers["idempotent-replayed"] == "true"
    assert (await bench.axis())["position"]["steps"] == 1000
    other = await bench.post("/nodes/1/axes/0/move?wait=30", body | {"target": 5}, headers=key)
    assert (other.status_code, other.json()["code"]) == (422, "key_reused")


async def test_a_command_in_flight_holds_its_key(bench: Bench) -> None:
    await bench.enable()
    key = {"Idempotency-Key": "slow"}
    body = {"target": 200_000, "unit": "steps"}
    first = asyncio.create_task(bench.post("/nodes/1/axes/0/move?wait=60", body, headers=key))
    await bench.until_moving()
    second = await bench.post("/nodes/1/axes/0/move?wait=60", body, headers=key)
    assert (second.status_code, second.json()["code"]) == (409, "key_in_flight")
    assert (await first).json()["state"] == "succeeded"


async def test_a_key_is_free_again_after_a_refusal_and_spent_by_what_was_begun(bench: Bench) -> None:
    body = {"target": 1000, "relative": True, "unit": "steps"}
    key = {"Idempotency-Key": "patient"}
    refused = await bench.post("/nodes/1/axes/0/move?wait=30", body, headers=key)
    assert (refused.status_code, refused.json()["code"]) == (409, "not_ready")
    await bench.enable()
    for _ in range(2):
        done = await bench.post("/nodes/1/axes/0/move?wait=30", body, headers=key)
        assert done.json()["result"]["position"]["steps"] == 1000
    elsewhere = await bench.post("/nodes/1/axes/1/move?wait=30", body, headers=key)
    assert (elsewhere.status_code, elsewhere.json()["code"]) == (422, "key_reused")
    assert "new Idempotency-Key" in elsewhere.json()["hint"]


async def test_a_client_that_goes_while_it_waits_leaves_its_key_answered(bench: Bench) -> None:
    """The move goes on; who asks again with the key gets its operation at once, not 409 for minutes."""
    await bench.enable()
    body = json.dumps({"target": 10_000_000, "unit": "steps"}).encode()
    key = {"Idempotency-Key": "gone"}
    gone = asyncio.Event()
    messages = iter([{"type": "http.request", "body": body, "more_body": False}])

    async def receive() -> Message:
        if (message := next(messages, None)) is not None:
            return message
        await gone.wait()
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        pass

    request = bench.client.build_request(
        "POST",
        "/api/v1/nodes/1/axes/0/move?wait=600",
        content=body,
        headers={"Content-Type": "application/json", **key},
    )
    scope = EventClient(bench.app).scope() | {
        "method": "POST",
        "path": request.url.path,
        "query_string": request.url.query,
        "headers": [(name.lower(), value) for name, value in request.headers.raw],
    }
    first = asyncio.create_task(bench.app(scope, receive, send))
    await bench.until_moving()
    gone.set()
    await asyncio.wait_for(first, 1)
    again = await bench.client.send(request)
    assert (again.status_code, again.headers["idempotent-replayed"]) == (202, "true")
    operation = (await bench.client.get(again.headers["location"])).json()
    assert operation["state"] == "running"


async def test_shutdown_stops_the_axes_at_once_and_takes_no_new_command(bench: Bench) -> None:
    await bench.enable()
    operation = (await bench.move(10_000_000)).json()
    await bench.until_moving()
    bench.service.begin_shutdown()
    ended = (await bench.get(f"/operations/{operation['id']}?wait=10")).json()
    assert ended["state"] == "cancelled"
    assert "shutting down" in ended["reason"]
    for command in ("enable", "reset-fault"):
        refused = await bench.post(f"/nodes/1/axes/0/{command}")
        assert (refused.status_code, refused.json()["code"]) == (503, "shutting_down")
    assert (await bench.move(1)).status_code == 503
    assert (await bench.post("/nodes/1/axes/0/stop")).status_code == 200


async def test_after_the_end_every_axis_is_disabled() -> None:
    async with running() as bench:
        await bench.until_ready()
        await bench.enable("0", "2")
        await bench.move(10_000_000)
        await bench.until_moving()
        await bench.service.close()
        assert {axis.state.value for axis in bench.module.module.axes} == {"switch_on_disabled"}


async def test_a_bug_in_the_drivers_is_told_and_ends_the_service(bench: Bench) -> None:
    told = asyncio.Event()
    bench.service.on_failure = told.set
    bench.service.network._on_bug(RuntimeError("a bug"))
    await asyncio.wait_for(told.wait(), 5)
    assert (await bench.client.get("/readyz")).status_code == 503
    assert (await bench.get("/stop")).json()["latched"] is True


async def test_the_security_checks_stand_before_everything(bench: Bench) -> None:
    path = "/api/v1/nodes/1/axes/0/enable"
    json_type = {"Content-Type": "application/json"}
    for headers, status in (
        ({**json_type, "Host": "evil.example"}, 421),
        ({**json_type, "Origin": "http://evil.example"}, 403),
        ({**json_type, "Origin": "null"}, 403),
        ({"Content-Type": "text/plain"}, 415),
        ({}, 415),
    ):
        response = await bench.client.post(path, headers=headers)
        assert response.status_code == status
        assert response.headers["content-type"] == "application/problem+json"
        assert response.json()["hint"]
    assert (await bench.axis())["state"] == "switch_on_disabled"


async def test_with_a_token_everything_but_the_probes_needs_it() -> None:
    configuration = Configuration.model_validate({"server": {"token": "correct-horse-battery-9"}})
    async with running(configuration) as bench:
        assert (await bench.get("/nodes")).status_code == 401
        assert (await bench.client.post("/api/v1/stop")).status_code == 401
        assert (await bench.client.get("/metrics")).status_code == 401
        assert (await bench.client.get("/livez")).status_code == 200
        headers = {"Authorization": "Bearer correct-horse-battery-9"}
        assert (await bench.get("/nodes", headers=headers)).status_code == 200
