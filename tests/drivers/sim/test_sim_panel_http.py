"""The fault panel over HTTP, without a socket: every command of the table, and its refusals."""

from __future__ import annotations

from collections.abc import AsyncIterator

import httpx
import pytest
from openapi_spec_validator import OpenAPIV31SpecValidator, validate

from app.configuration.configuration import Configuration
from app.panel.application import create_panel
from drivers.devices.catalog import Catalog
from drivers.sim.panel import COMMANDS
from drivers.sim.station import Station

PORT = 8403
PROFILE = Catalog.load().profile("TMCM-3216")
NODE = "/panel/v1/nodes/1"
ARGUMENTS = {
    "press_switch": {"axis": 1, "switch": "home"},
    "release_switch": {"axis": 1, "switch": "home"},
    "set_load": {"axis": 0, "share": 0.5},
    "set_supply": {"volts": 12},
    "set_temperature": {"axis": 0, "celsius": 130},
    "short": {"axis": 0, "bridge": "a"},
    "open_load": {"axis": 0, "bridge": "a"},
    "set_digital_input": {"terminal": 0, "level": True},
    "set_analog_input": {"terminal": 0, "value": 4095},
    "report_error": {"code": 0x8110},
    "set_sdo_delay": {"seconds": 0.5},
    "drop_frames": {"cob_id": "0x181", "count": 3},
    "delay_frames": {"cob_id": 0x181, "seconds": 1},
    "truncate_frames": {"cob_id": 0x181, "length": 2},
    "duplicate_frames": {"cob_id": 0x181},
    "corrupt_frames": {"cob_id": 0x181},
    "block": {"axis": 2},
    "unblock": {"axis": 2},
    "mend": {"axis": 2},
    "set_shutdown_input": {"active": True},
    "set_silent": {"active": True},
    "set_deaf": {"active": True},
    "set_no_boot_up": {"active": True},
    "set_sdo_mute": {"active": True},
}


@pytest.fixture
async def station() -> AsyncIterator[Station]:
    async with Station((1, 5), PROFILE) as station:
        yield station


@pytest.fixture
async def http(station: Station) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(create_panel(station, PORT))
    async with httpx.AsyncClient(transport=transport, base_url=f"http://127.0.0.1:{PORT}") as client:
        yield client


async def test_it_shows_every_module(http: httpx.AsyncClient) -> None:
    nodes = (await http.get("/panel/v1/nodes")).json()["nodes"]
    assert [node["node"] for node in nodes] == [1, 5]
    one = (await http.get(NODE)).json()
    assert one["clock"] >= nodes[0]["clock"]
    assert one == nodes[0] | {"clock": one["clock"]}
    assert (one["powered"], one["nmt_state"], one["bus"]) == (True, "pre_operational", "active")
    assert one["axes"][2]["state"] == "switch_on_disabled"
    assert one["axes"][2]["place"] == 0


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "stall"])
async def test_every_command_is_there_and_answers_with_the_state(
    http: httpx.AsyncClient, command: str
) -> None:
    reply = await http.post(f"{NODE}/{command}", json=ARGUMENTS.get(command, {}))
    assert reply.status_code == 200, reply.text
    assert reply.json()["node"] == 1


async def test_a_switch_is_pressed_and_everything_cleared(http: httpx.AsyncClient) -> None:
    pressed = await http.post(f"{NODE}/press_switch", json={"axis": 1, "switch": "home"})
    assert pressed.json()["axes"][1]["switches"] == ["home"]
    cleared = await http.post(f"{NODE}/clear", json={})
    assert cleared.json()["axes"][1]["switches"] == []


async def test_a_command_without_arguments_needs_no_body_but_the_content_type(
    http: httpx.AsyncClient,
) -> None:
    json_type = {"Content-Type": "application/json"}
    assert (await http.post(f"{NODE}/power_cycle", headers=json_type)).status_code == 200
    assert (await http.post(f"{NODE}/power_cycle")).status_code == 415


@pytest.mark.parametrize(
    ("path", "body", "status", "code", "told"),
    [
        ("/press_switch", b'{"axis": 0, "switch": "left"}', 422, "bad_value", "one of negative, positive"),
        ("/block", b'{"axis": 3}', 422, "bad_value", "axis must be from 0 to 2, not 3"),
        ("/block", b"{}", 422, "bad_value", "block needs axis"),
        ("/block", b'{"axis": 0, "why": 1}', 422, "bad_value", "takes no 'why'"),
        ("/set_sdo_delay", b'{"seconds": NaN}', 422, "bad_value", "from 0 to 3600, not nan"),
        ("/block", b"[0]", 422, "bad_request", "must be an object"),
        ("/block", b'{"axis"', 422, "bad_request", "no JSON text"),
        ("/block", b"\xff", 422, "bad_request", "no JSON text"),
        ("/block", b"[" * 30_000, 422, "bad_request", "no JSON text"),
        ("/stall", b'{"axis": 0}', 409, "not_ready", "axis 0 stands"),
        ("/explode", b"{}", 404, "unknown_path", "no command 'explode'"),
    ],
)
async def test_a_refusal_is_a_problem_that_says_what_is_allowed(
    http: httpx.AsyncClient, path: str, body: bytes, status: int, code: str, told: str
) -> None:
    reply = await http.post(NODE + path, content=body, headers={"Content-Type": "application/json"})
    assert reply.headers["content-type"] == "application/problem+json"
    assert (reply.status_code, reply.json()["code"]) == (status, code)
    assert told in reply.json()["detail"]
    assert (await http.get(reply.json()["type"])).json()["code"] == code


@pytest.mark.parametrize("node", ["2", "0", "128", "x"])
async def test_a_module_that_is_not_simulated_is_no_server_error(http: httpx.AsyncClient, node: str) -> None:
    for reply in (await http.get(f"/panel/v1/nodes/{node}"), await http.get(f"/panel/v1/nodes/{node}/x")):
        assert reply.status_code in (404, 405, 422)
        assert reply.headers["content-type"] == "application/problem+json"
    assert "Simulated are: 1, 5." in (await http.get("/panel/v1/nodes/2")).json()["hint"]


async def test_the_house_is_locked_as_that_of_the_service(http: httpx.AsyncClient) -> None:
    assert (await http.get(NODE, headers={"Host": "evil.example"})).status_code == 421
    foreign = await http.post(f"{NODE}/power_off", json={}, headers={"Origin": "http://evil.example"})
    assert foreign.status_code == 403
    form = await http.post(f"{NODE}/power_off", data={"a": "b"})
    assert form.status_code == 415
    assert (await http.get(NODE)).json()["powered"] is True


async def test_the_documentation_has_each_command_with_its_limits(http: httpx.AsyncClient) -> None:
    document = (await http.get("/openapi.json")).json()
    validate(document, cls=OpenAPIV31SpecValidator)
    for name, command in COMMANDS.items():
        operation = document["paths"][f"/panel/v1/nodes/{{node}}/{name}"]["post"]
        assert operation["operationId"] == name
        assert operation["summary"] == command.summary.removesuffix(".")
        assert operation["requestBody"]["content"]["application/json"]["schema"] == command.schema()
    assert (await http.get("/docs")).status_code == 200


def test_the_service_itself_has_no_panel() -> None:
    from app.main import create_app

    assert not [path for path in create_app(Configuration()).openapi()["paths"] if "panel" in path]
