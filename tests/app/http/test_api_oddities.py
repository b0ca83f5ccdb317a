"""What no client should send: each gets a documented status, a problem, and a sentence on what to do.

What moves nothing shares a service: starting one takes longer than all its requests.
"""

from __future__ import annotations

import gzip
import json
import logging
from typing import Any

import httpx
import pytest
from api_bench import Bench, running
from repository import ROOT

from app.configuration.configuration import Configuration

pytestmark = pytest.mark.looptime

DOCUMENT: dict[str, Any] = json.loads((ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8"))
JSON = {"Content-Type": "application/json"}
MOVE = "/api/v1/nodes/1/axes/0/move"


def told(response: httpx.Response, status: int) -> dict[str, Any]:
    """The problem in a reply, as a user would want it."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    problem = response.json()
    for sentence in (problem["detail"], problem["hint"]):
        assert sentence.endswith((".", "?"))
        for jargon in ("Input should", "pydantic", "body.", "Traceback", "NoneType"):
            assert jargon not in sentence
    return problem


BAD_BODIES = [
    ('{"target": NaN, "unit": "steps"}', "target", "finite"),
    ('{"target": 1e400, "unit": "steps"}', "target", "finite"),
    ('{"target": true, "unit": "steps"}', "target", "number"),
    ('{"target": "7", "unit": "steps"}', "target", "number"),
    ('{"target": 1}', "unit", "required"),
    ('{"target": 1, "unit": "steps", "speed": 3}', "speed", "velocity"),
    ('{"target": 1, "unit": "steps", "velocity": 0}', "velocity", "above 0"),
    ("", "body", "object"),
    ("[]", "body", "object"),
    ("{", "body", "JSON"),
    ("[" * 5000, "body", "JSON"),
    ('{"target": ' + "9" * 5000 + ', "unit": "steps"}', "body", "JSON"),
]


async def test_a_bad_body_names_the_field_and_what_it_takes(bench: Bench) -> None:
    for body, field, words in BAD_BODIES:
        problem = told(await bench.client.post(MOVE, content=body, headers=JSON), 422)
        assert [error["field"] for error in problem["errors"]] == [field]
        assert words in problem["errors"][0]["message"]
        assert words in problem["detail"]


BAD_VALUES = [
    ({"target": 1e3}, "without point"),
    ({"target": -0.0}, "without point"),
    ({"target": 2**31}, "-2147483648 to 2147483647"),
    ({"target": 1, "unit": "furlong"}, "steps"),
    ({"target": 1, "velocity": 10**9}, "velocity"),
]


async def test_a_value_that_no_axis_takes_says_what_it_takes(bench: Bench) -> None:
    await bench.enable()
    for body, words in BAD_VALUES:
        problem = told(await bench.post("/nodes/1/axes/0/move", {"unit": "steps", **body}), 422)
        assert words in problem["hint"]


async def test_json_is_utf_8_whatever_the_content_type_adds(bench: Bench) -> None:
    await bench.enable()
    text = '{"target": 0, "unit": "steps"}'
    for parameter in ("charset=utf-8", "charset=latin-1", "x"):
        headers = {"Content-Type": f"application/json; {parameter}"}
        assert (await bench.client.post(f"{MOVE}?wait=9", content=text, headers=headers)).status_code == 200
    packed = gzip.compress(text.encode())
    headers = JSON | {"Content-Encoding": "gzip"}
    told(await bench.client.post(MOVE, content=packed, headers=headers), 422)


async def test_a_get_with_a_body_is_a_get(bench: Bench) -> None:
    response = await bench.client.request("GET", "/api/v1/nodes/1/axes/0", content=b"{", headers=JSON)
    assert response.status_code == 200


ODD_PATHS = [
    ("/api/v1/nodes/0", 404),
    ("/api/v1/nodes/128", 404),
    ("/api/v1/nodes/-1", 404),
    ("/api/v1/nodes/0x1", 404),
    ("/api/v1/nodes/%F0%9F%98%80", 404),
    ("/api/v1/nodes/%ff%00", 404),
    ("/api/v1/nodes/x%0d%0aSet-Cookie:y", 404),
    ("/api/v1/nodes/" + "a" * 65, 422),
    ("/api/v1/nodes/" + "a" * 9000, 422),
    ("/api/v1/nodes/1/axes/-1", 404),
    ("/api/v1/nodes/1/axes/%D9%A3", 404),
    ("/api/v1/nodes/", 404),
    ("/api/v1//nodes", 404),
    ("/api/v1/nodes/1%2F", 404),
    ("/", 404),
    ("/docs/assets", 404),
    ("/docs/assets/..%2F..%2Fapp", 404),
    ("/api/v1/operations?limit=x", 422),
    ("/api/v1/operations?state=lost", 422),
    ("/api/v1/nodes/1/objects/0x6064/0x0", 422),
]


async def test_odd_paths(bench: Bench) -> None:
    for path, status in ODD_PATHS:
        told(await bench.client.get(path), status)


async def test_other_methods_are_told_which_there_are(bench: Bench) -> None:
    for path in ("/api/v1/nodes", MOVE, "/api/v1/stop", "/livez"):
        allowed = {m.upper() for m in DOCUMENT["paths"][path.replace("/1/axes/0", "/{node}/axes/{axis}")]}
        for method in ("OPTIONS", "PUT", "PATCH", "DELETE", "TRACE"):
            response = await bench.client.request(method, path, headers=JSON)
            told(response, 405)
            assert set(response.headers["allow"].split(", ")) == allowed


async def test_head_is_a_get_without_its_body(bench: Bench) -> None:
    for path in ("/api/v1/nodes", "/livez", "/docs", "/metrics"):
        response = await bench.client.head(path)
        assert (response.status_code, response.content) == (200, b"")
        assert int(response.headers["content-length"]) > 0
    told_nothing = await bench.client.head("/api/v1/events")
    assert told_nothing.status_code == 405  # a stream has no end to wait for


NO_PREFERENCES = [
    "wait=",
    "wait=x",
    "wait=-1",
    "wait=1.5",
    "waiting=3",
    "x" * 300,
    '"',
    "wait=1000000000000",
    "é",
]


async def test_a_preference_that_is_none_is_ignored(bench: Bench) -> None:
    await bench.enable()
    for prefer in NO_PREFERENCES:
        headers = JSON | {"Prefer": prefer}
        content = json.dumps({"target": 100, "unit": "steps"})
        response = await bench.client.post(
            MOVE, content=content, headers={k.encode(): v.encode("latin-1") for k, v in headers.items()}
        )
        assert response.status_code == 202
        assert "preference-applied" not in response.headers
        await bench.get(f"/operations/{response.json()['id']}?wait=30")


async def test_no_token_is_ever_logged(
    caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.DEBUG)
    caplog.set_level(logging.WARNING, "httpx")  # the client's own log
    secret, wrong = "correct-horse-battery-9", "wrong-horse-staple-x"
    async with running(Configuration.model_validate({"server": {"token": secret}})) as bench:
        # a bug, the loudest that we can be
        bench.service.network.stop_all = None  # pyright: ignore[reportAttributeAccessIssue]
        for token in (secret, wrong):
            headers = {"Authorization": f"Bearer {token}"}
            await bench.get(f"/nodes?token={token}", headers=headers)
            await bench.get("/nothing", headers=headers)
            await bench.post("/nodes/1/axes/0/move", {"target": token}, headers=headers)
        with pytest.raises(TypeError):
            await bench.post("/stop", headers={"Authorization": f"Bearer {secret}"})
    out, err = capfd.readouterr()
    assert "unexpected error" in caplog.text + out + err
    for token in (secret, wrong):
        assert token not in caplog.text + out + err
