"""Every route of the service under the rules that hold for each: roles, foreign pages, GET moves nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from api_bench import Bench, EventClient, running
from repository import ROOT

from app.access.roles import COMMANDS, WEBSOCKET, Role
from app.access.tokens import add_token
from app.configuration.configuration import Configuration
from drivers.bus.frame import Frame

pytestmark = pytest.mark.looptime

JSON = {"Content-Type": "application/json"}
DOCUMENT: dict[str, Any] = json.loads((ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8"))
EXAMPLES = {"node": "1", "axis": "0", "index": "0x1018", "sub": "1", "id": "none", "name": "not-ready"}
STREAM = "/api/v1/events"


def operations() -> Iterator[tuple[str, str, str]]:
    """Method, template and an example of the path of every operation; the stream is no request that ends."""
    for template, methods in DOCUMENT["paths"].items():
        path = re.sub(r"{(\w+)}", lambda match: EXAMPLES.get(match[1], "1"), template)
        for method in methods:
            if template != STREAM:
                yield method.upper(), template, path


COMMANDED = [(method, path) for method, _, path in operations() if method != "GET"]
READ = [path for method, _, path in operations() if method == "GET"]


def test_the_document_and_the_table_of_roles_name_the_same_commands() -> None:
    documented = {(method, template) for method, template, _ in operations() if method != "GET"}
    commands = [row for row in COMMANDS if row[0] != WEBSOCKET]  # for which OpenAPI has no words
    assert documented == {(method, path) for method, path, _ in commands}, "new commands belong into COMMANDS"
    for method, template, role in commands:
        assert DOCUMENT["paths"][template][method.lower()]["x-role"] == role.word


async def test_no_page_of_elsewhere_commands_or_reads_anything(bench: Bench) -> None:
    for method, path in [*COMMANDED, *(("GET", path) for path in READ)]:
        for headers, status in (
            ({"Host": "evil.example"}, 421),
            ({"Origin": "http://evil.example"}, 403),
            ({"Origin": "null"}, 403),
        ):
            response = await bench.client.request(method, path, headers={**JSON, **headers})
            assert response.status_code == status, (method, path)
            assert not [name for name in response.headers if name.startswith("access-control")]


async def test_commands_need_the_json_content_type_unless_they_stop(bench: Bench) -> None:
    for method, path in COMMANDED:
        for headers in ({}, {"Content-Type": "text/plain"}):
            response = await bench.client.request(method, path, headers=headers)
            expected = 200 if path.endswith("stop") else 415
            assert response.status_code == expected, (method, path)


async def test_reading_everything_sends_nothing_that_moves_or_writes(bench: Bench) -> None:
    await bench.enable()
    sent: list[Frame] = []
    original = bench.master_port.send

    def note(frame: Frame, *, urgent: bool = False, answered: bool = True) -> None:
        sent.append(frame)
        original(frame, urgent=urgent, answered=answered)

    bench.master_port.send = note
    for path in READ:
        for method in ("GET", "HEAD"):
            response = await bench.client.request(method, path)
            assert response.status_code < 500, path
    uploads = [frame for frame in sent if frame.cob_id == 0x601]
    assert uploads, "an object was read"
    assert {frame.data[0] >> 5 for frame in uploads} <= {2, 3}, "SDO uploads alone"
    others = {frame.cob_id for frame in sent} - {0x601}
    assert all(0x700 <= cob_id <= 0x77F for cob_id in others), "and our heartbeat"


@pytest.fixture
def secrets(tmp_path: Path) -> dict[Role, str]:
    return {role: add_token(tmp_path / "tokens", f"may-{role.word}", role) for role in Role}


def bearer(secret: str) -> dict[str, str]:
    return {**JSON, "Authorization": f"Bearer {secret}"}


async def test_each_role_gives_its_commands_and_no_more(tmp_path: Path, secrets: dict[Role, str]) -> None:
    configuration = Configuration.model_validate({"server": {"token_file": tmp_path / "tokens"}})
    async with running(configuration) as bench:
        for method, template, path in operations():
            needed = Role[DOCUMENT["paths"][template][method.lower()]["x-role"].upper()]
            for role, secret in secrets.items():
                response = await bench.client.request(method, path, headers=bearer(secret))
                refused = response.status_code == 403 and response.json()["code"] == "forbidden_role"
                assert refused == (role < needed), (method, path, role)


async def test_a_browser_opens_the_stream_with_a_ticket_of_its_own_role(
    tmp_path: Path, secrets: dict[Role, str]
) -> None:
    configuration = Configuration.model_validate({"server": {"token_file": tmp_path / "tokens"}})
    async with running(configuration) as bench:
        assert (await bench.post("/tickets")).status_code == 401
        given = await bench.post("/tickets", headers=bearer(secrets[Role.READ]))
        assert given.status_code == 201
        assert given.json()["role"] == "read"
        ticket = given.json()["ticket"]
        refused = await bench.post(f"/stop/reset?ticket={ticket}")
        assert refused.status_code == 401
        async with WithTicket(bench.app, ticket) as stream:
            assert (await stream.next()).kind == "snapshot"
        async with WithTicket(bench.app, ticket) as stream:
            await stream.ended()
            assert stream.status == 401


class WithTicket(EventClient):
    """An EventSource whose URL carries a ticket."""

    def __init__(self, app: Any, ticket: str) -> None:
        super().__init__(app)
        self._ticket = ticket

    def scope(self) -> Any:
        return super().scope() | {"query_string": f"ticket={self._ticket}".encode()}


async def test_who_commanded_what_is_kept_and_no_secret_with_it(
    tmp_path: Path, secrets: dict[Role, str]
) -> None:
    file = tmp_path / "audit.jsonl"
    configuration = Configuration.model_validate(
        {"server": {"token_file": tmp_path / "tokens"}, "audit": {"file": file}}
    )
    async with running(configuration) as bench:
        await bench.until_ready()
        await bench.post("/nodes/1/axes/0/enable", headers=bearer(secrets[Role.MOVE]))
        move: httpx.Response = await bench.post(
            "/nodes/1/axes/0/move?wait=30",
            {"target": 70, "unit": "steps"},
            headers=bearer(secrets[Role.MOVE]),
        )
        await bench.post(
            "/nodes/1/axes/0/move", {"target": secrets[Role.READ]}, headers=bearer(secrets[Role.MOVE])
        )
        await bench.post("/nodes/1/axes/0/move", {"target": 1}, headers=bearer(secrets[Role.READ]))
        await bench.post("/stop")
        await bench.get("/nodes", headers=bearer(secrets[Role.READ]))
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    told = [(line.get("who"), line["path"].rpartition("/")[2], line["status"]) for line in lines]
    assert told == [
        ("may-move", "enable", 200),
        ("may-move", "move", 200),
        ("may-move", "move", 422),
        ("may-read", "move", 403),
        (None, "stop", 401),
    ]
    assert lines[1]["body"] == {"target": 70, "unit": "steps"}
    assert lines[1]["operation"] == move.json()["id"]
    assert move.json()["asked_by"]["name"] == "may-move"
    assert lines[1]["client"] == "127.0.0.1"
    for secret in secrets.values():
        assert secret not in file.read_text()


async def test_a_record_that_can_not_be_written_disturbs_no_command(tmp_path: Path) -> None:
    configuration = Configuration.model_validate({"audit": {"file": tmp_path / "missing" / "audit.jsonl"}})
    async with running(configuration) as bench:
        await bench.until_ready()
        await bench.enable()
        await bench.service.audit.close()  # until the thread has tried
        ready = await bench.client.get("/readyz")
        assert ready.status_code == 200
        assert any("record of commands" in warning for warning in ready.json()["warnings"])
        metrics = (await bench.client.get("/metrics")).text
        assert "canaxis_audit_up 0.0" in metrics
        assert "canaxis_audit_lost_total 1.0" in metrics
