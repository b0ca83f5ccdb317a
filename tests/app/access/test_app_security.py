"""The middleware alone, before an application that says yes to everything."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator

import httpx
import pytest
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import Message, Receive, Scope, Send

from app.access import security
from app.access.bodies import MAX_BODY
from app.access.policy import Policy
from app.access.roles import Role, is_stop
from app.access.security import SecurityMiddleware
from app.access.tickets import Tickets
from app.access.tokens import Principal
from app.configuration.configuration import ServerConfiguration
from app.http.rates import RateLimit

TOKEN = "correct-horse-battery-9"
JSON = {"Content-Type": "application/json"}


async def yes(scope: Scope, receive: Receive, send: Send) -> None:
    body = await Request(scope, receive).body()
    await PlainTextResponse(f"yes {len(body)}")(scope, receive, send)


def client(base: str = "http://127.0.0.1:8402", **server: object) -> httpx.AsyncClient:
    policy = Policy.of(ServerConfiguration.model_validate(server))
    return httpx.AsyncClient(
        transport=httpx.ASGITransport(SecurityMiddleware(yes, policy, Tickets())), base_url=base
    )


@pytest.mark.parametrize("host", ["127.0.0.1:8402", "localhost:8402", "LOCALHOST:8402", "[::1]:8402"])
async def test_our_own_hosts_are_answered(host: str) -> None:
    async with client() as http:
        assert (await http.get("/x", headers={"Host": host})).status_code == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8402", "127.0.0.1", "localhost:80", "localhost:8402.evil.example", ""],
)
async def test_foreign_hosts_are_refused(host: str) -> None:
    async with client() as http:
        response = await http.get("/x", headers={"Host": host})
    assert response.status_code == 421
    assert response.headers["content-type"] == "application/problem+json"
    assert response.json()["code"] == "misdirected"


async def test_more_hosts_come_from_the_settings() -> None:
    async with client(allowed_hosts=["lab-pc", "proxy:9000"]) as http:
        for host in ("lab-pc", "lab-pc:8402", "proxy:9000"):
            assert (await http.get("/x", headers={"Host": host})).status_code == 200
        assert (await http.get("/x", headers={"Host": "proxy:8402"})).status_code == 421


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "http://localhost", "http://localhost:8402.evil.example", "file://", ""],
)
@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE"])
async def test_a_page_of_elsewhere_commands_nothing(origin: str, method: str) -> None:
    async with client() as http:
        response = await http.request(method, "/stop", headers={**JSON, "Origin": origin})
    assert response.status_code == 403
    assert response.json()["code"] == "forbidden_origin"


async def test_own_and_listed_origins_may_read_and_command() -> None:
    async with client(allowed_origins=["https://panel.lab/"]) as http:
        for origin in ("http://127.0.0.1:8402", "http://localhost:8402", "https://panel.lab"):
            headers = {**JSON, "Origin": origin, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "cors"}
            assert (await http.post("/x", headers=headers)).status_code == 200
            assert (await http.get("/x", headers=headers)).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},  # an EventSource, or a fetch with CORS
        {"Origin": "https://127.0.0.1:8403"},
        {"Origin": "http://127.0.0.1:8402, http://evil.example"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"},  # an image, a script
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "cors"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "websocket"},
    ],
)
async def test_a_page_of_elsewhere_reads_nothing_either(headers: dict[str, str]) -> None:
    """Its browser wouldn't show it the answer, but asking takes streams and time on the bus."""
    async with client() as http:
        response = await http.get("/api/v1/events", headers=headers)
    assert response.status_code == 403
    assert response.json()["code"] == "forbidden_origin"


async def test_one_foreign_origin_among_several_is_one_too_many() -> None:
    async with client() as http:
        headers = [("Origin", "http://127.0.0.1:8402"), ("Origin", "http://evil.example")]
        assert (await http.get("/x", headers=headers)).status_code == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"},  # a link to the documentation
        {"Sec-Fetch-Site": "same-origin", "Sec-Fetch-Mode": "cors"},
        {"Sec-Fetch-Site": "none", "Sec-Fetch-Mode": "navigate"},
    ],
)
async def test_a_link_from_elsewhere_may_be_followed(headers: dict[str, str]) -> None:
    async with client() as http:
        assert (await http.get("/docs", headers=headers)).status_code == 200


@pytest.mark.parametrize("host", ["127.0.0.1:8402", "evil.example"])
async def test_every_reply_tells_browsers_what_not_to_do_with_it(host: str) -> None:
    async with client() as http:
        headers = (await http.get("/x", headers={"Host": host})).headers
    assert headers["x-frame-options"] == "DENY", "or a page could have its visitor click on our documentation"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cross-origin-resource-policy"] == "same-origin"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8402"])
async def test_the_event_stream_is_no_way_around_the_host_check(host: str) -> None:
    async with client() as http:
        response = await http.get("/api/v1/events", headers={"Host": host, "Accept": "text/event-stream"})
    assert response.status_code == 421


async def test_two_hosts_are_refused() -> None:
    async with client() as http:
        headers = [("Host", "127.0.0.1:8402"), ("Host", "evil.example")]
        assert (await http.get("/x", headers=headers)).status_code == 421


async def test_null_can_not_be_allowed() -> None:
    async with client(allowed_origins=["null"]) as http:
        assert (await http.post("/x", headers={**JSON, "Origin": "null"})).status_code == 403


@pytest.mark.parametrize(
    "content_type",
    [None, "text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "application/jsonp", ""],
)
@pytest.mark.parametrize("path", ["/api/v1/nodes/1/axes/0/enable", "/api/v1/stop/reset"])
async def test_a_command_needs_the_json_content_type_body_or_not(content_type: str | None, path: str) -> None:
    headers = {} if content_type is None else {"Content-Type": content_type}
    async with client() as http:
        response = await http.post(path, headers=headers)
    assert response.status_code == 415
    assert response.json()["code"] == "json_required"


@pytest.mark.parametrize(
    "path", ["/api/v1/stop", "/api/v1/nodes/1/axes/0/stop", "/api/v1/nodes/1/axes/0/quick-stop"]
)
async def test_stopping_needs_no_content_type_unless_a_body_comes(path: str) -> None:
    async with client() as http:
        assert (await http.post(path)).status_code == 200
        for tool in ("text/plain", "application/x-www-form-urlencoded"):  # `curl -d ''` says the latter
            assert (await http.post(path, headers={"Content-Type": tool})).status_code == 200
        assert (
            await http.post(path, content=b"x", headers={"Content-Type": "text/plain"})
        ).status_code == 415
        assert (await http.post(path, content=b"{}")).status_code == 415
        assert (await http.post(path, headers={"Origin": "http://evil.example"})).status_code == 403


async def test_a_parameter_of_the_content_type_is_fine() -> None:
    async with client() as http:
        response = await http.post(
            "/x", content=b"{}", headers={"Content-Type": "Application/JSON; charset=utf-8"}
        )
    assert response.text == "yes 2"


@pytest.mark.parametrize(
    "header", [None, "Bearer wrong", f"Basic {TOKEN}", TOKEN, "Bearer", f"Bearer {TOKEN}x", "Bearer tök"]
)
async def test_without_the_token_nothing_is_told(header: str | None) -> None:
    headers = {} if header is None else {b"Authorization": header.encode("latin-1")}
    async with client(token=TOKEN) as http:
        response = await http.get("/metrics", headers=headers)
    assert response.status_code == 401
    assert response.headers["www-authenticate"].startswith("Bearer")
    assert TOKEN not in response.text


@pytest.mark.parametrize("query", ["token", "access_token", "authorization"])
async def test_a_token_in_the_url_is_refused_even_beside_a_good_one(query: str) -> None:
    async with client(token=TOKEN) as http:
        refused = await http.get(f"/x?{query}={TOKEN}", headers={"Authorization": f"Bearer {TOKEN}"})
    assert (refused.status_code, refused.json()["code"]) == (400, "token_in_url")
    assert TOKEN not in refused.text


async def test_the_token_opens_and_probes_need_none() -> None:
    async with client(token=TOKEN) as http:
        assert (await http.get("/x", headers={"Authorization": f"bearer {TOKEN}"})).status_code == 200
        for path in ("/livez", "/readyz", "/docs", "/openapi.json", "/problems/not-ready"):
            assert (await http.get(path)).status_code == 200


async def test_a_large_body_is_refused_declared_or_not() -> None:
    async def chunks() -> AsyncIterator[bytes]:
        for _ in range(MAX_BODY // 1024 + 1):
            yield bytes(1024)

    async with client() as http:
        assert (await http.post("/x", content=bytes(MAX_BODY), headers=JSON)).status_code == 200
        assert (await http.post("/x", content=bytes(MAX_BODY + 1), headers=JSON)).status_code == 413
        assert (await http.post("/x", content=chunks(), headers=JSON)).status_code == 413


async def test_a_request_that_breaks_off_is_not_carried_out() -> None:
    called = False

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        nonlocal called
        called = True

    messages: list[Message] = [
        {"type": "http.request", "body": b"{", "more_body": True},
        {"type": "http.disconnect"},
    ]
    sent: list[Message] = []

    async def receive() -> Message:
        return messages.pop(0)

    async def send(message: Message) -> None:
        sent.append(message)

    headers = [(b"host", b"localhost:8402"), (b"content-type", b"application/json")]
    scope = {"type": "http", "method": "POST", "path": "/x", "headers": headers}
    await SecurityMiddleware(app, Policy.of(ServerConfiguration()), Tickets())(scope, receive, send)
    assert not called
    assert not sent


class Socket:
    """A WebSocket's handshake, as a server hands it to the application."""

    def __init__(self, app: SecurityMiddleware) -> None:
        self._app = app
        self.sent: list[Message] = []

    async def send(self, message: Message) -> None:
        self.sent.append(message)

    async def receive(self) -> Message:
        return {"type": "websocket.connect"}

    async def open(self, query: bytes = b"", /, **headers: str) -> Message:
        """What the application says first."""
        own = {"host": "localhost:8402", **headers}
        scope: Scope = {"type": "websocket", "path": "/api/v1/jog", "query_string": query, "state": {}}
        scope["headers"] = [(name.encode(), value.encode()) for name, value in own.items()]
        await self._app(scope, self.receive, self.send)
        return self.sent[-1]


async def accepts(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "websocket.accept"})


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({"host": "evil.example"}, "misdirected"),
        ({"origin": "http://evil.example"}, "forbidden_origin"),
        ({"origin": "null"}, "forbidden_origin"),
        ({"sec-fetch-site": "cross-site", "sec-fetch-mode": "websocket"}, "forbidden_origin"),
        ({}, "unauthorized"),
        ({"authorization": "Bearer x"}, "unauthorized"),
    ],
)
async def test_a_websocket_is_refused_before_it_is_accepted(headers: dict[str, str], code: str) -> None:
    policy = Policy.of(ServerConfiguration.model_validate({"token": TOKEN}))
    said = await Socket(SecurityMiddleware(accepts, policy, Tickets())).open(**headers)
    assert said == {"type": "websocket.close", "code": 1008, "reason": code}


async def test_a_websocket_takes_a_token_or_a_ticket_of_enough_role_once() -> None:
    tickets = Tickets()
    socket = Socket(
        SecurityMiddleware(accepts, Policy.of(ServerConfiguration.model_validate({"token": TOKEN})), tickets)
    )
    assert (await socket.open(authorization=f"Bearer {TOKEN}"))["type"] == "websocket.accept"
    ticket = tickets.issue(Principal("a", Role.CONFIGURE))
    assert (await socket.open(f"ticket={ticket}".encode()))["type"] == "websocket.accept"
    assert (await socket.open(f"ticket={ticket}".encode()))["reason"] == "unauthorized"
    low = tickets.issue(Principal("b", Role.MOVE))
    assert (await socket.open(f"ticket={low}".encode()))["reason"] == "forbidden_role"


async def test_a_ticket_opens_streams_alone() -> None:
    tickets = Tickets()
    policy = Policy.of(ServerConfiguration.model_validate({"token": TOKEN}))
    transport = httpx.ASGITransport(SecurityMiddleware(yes, policy, tickets))
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8402") as http:
        ticket = tickets.issue(Principal("a", Role.CONFIGURE))
        assert (await http.get(f"/api/v1/nodes?ticket={ticket}")).status_code == 401
        assert (await http.get(f"/api/v1/events?ticket={ticket}")).status_code == 200
        assert (await http.get(f"/api/v1/events?ticket={ticket}")).status_code == 401


async def test_a_flood_is_slowed_down_and_never_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    # On a clock that stands: on a slow machine a tenth of a second passes between any two requests.
    monkeypatch.setattr(security, "RateLimit", functools.partial(RateLimit, now=lambda: 0.0))
    async with client(requests_per_second=10) as http:
        answers = [(await http.get("/x")).status_code for _ in range(30)]
        refused = await http.post("/api/v1/nodes/1/axes/0/move", headers=JSON)
        stops = [(await http.post("/api/v1/stop")).status_code for _ in range(30)]
        cancelled = await http.post("/api/v1/operations/7/cancel", headers=JSON)
    assert cancelled.status_code == 200
    assert answers[:10] == [200] * 10
    assert 429 in answers
    assert (refused.status_code, refused.json()["code"]) == (429, "too_many_requests")
    assert int(refused.headers["retry-after"]) >= 1
    assert stops == [200] * 30


@pytest.mark.parametrize(
    ("path", "stops"),
    [
        ("/api/v1/stop", True),
        ("/api/v1/nodes/1/axes/0/stop", True),
        ("/api/v1/nodes/stop/axes/stop/quick-stop", True),
        ("/api/v1/nodes/{node}/axes/{axis}/stop", True),
        ("/api/v1/nodes/1/axes/0/positions/stop", False),
        ("/api/v1/nodes/1/axes/stop", False),
        ("/api/v1/nodes/1/outputs/quick-stop", False),
        ("/stop", False),
    ],
)
async def test_what_is_only_called_a_stop_is_none(path: str, stops: bool) -> None:
    assert is_stop(path) is stops
    async with client() as http:
        bare = await http.put(path)
    assert bare.status_code == (200 if stops else 415)


@pytest.mark.looptime
async def test_a_body_that_never_ends_is_not_waited_for() -> None:
    asked = 0

    async def receive() -> Message:
        nonlocal asked
        asked += 1
        await asyncio.sleep(1)
        return {"type": "http.request", "body": b" ", "more_body": True}

    sent: list[Message] = []

    async def send(message: Message) -> None:
        sent.append(message)

    headers = [(b"host", b"localhost:8402"), (b"content-type", b"application/json")]
    scope = {"type": "http", "method": "POST", "path": "/x", "headers": headers}
    policy = Policy.of(ServerConfiguration(request_timeout=5))
    await SecurityMiddleware(yes, policy, Tickets())(scope, receive, send)
    assert sent[0]["status"] == 408
    assert (b"connection", b"close") in sent[0]["headers"]
    assert asked <= 6
