"""Who may speak to the service: a pure ASGI middleware in front of everything else.

It refuses foreign Host headers (DNS rebinding), what a browser sends for a page of elsewhere, clients that
ask too often, tokens that are missing, wrong, or not entitled to the command, commands that are not declared
to be JSON (so that a page of elsewhere moves no motor even if the browser hides where it is from), and bodies
that are too large or too slow. CORS stays off, and no page may frame ours: a click in the documentation moves
motors too.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import parse_qsl

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.roles import WEBSOCKET, Role, is_cancel, is_stop, role_for
from app.access.tickets import Tickets
from app.access.tokens import LOCAL, Principal, Tokens
from app.configuration.configuration import ServerSettings, TrajectorySettings
from app.http.paths import API, SAFE_METHODS
from app.http.problems import problem
from app.http.rates import RateLimit
from app.http.replies import ClientGone, Refusal, refuse
from app.http.uploads import JSON, UPLOADS, Upload, Uploads

DOCS_ASSETS = "/docs/assets"
"""Where the interactive documentation's own script and style are: a lab's network may have no way out."""
PUBLIC_PATHS = frozenset({"/livez", "/readyz", "/docs", "/openapi.json"})
PUBLIC_FOLDERS = ("/problems/", f"{DOCS_ASSETS}/")
STREAM_PATHS = frozenset({f"{API}/events"})
"""What a ticket opens; any WebSocket besides."""
TOKEN_PARAMETERS = frozenset(
    {"token", "access_token", "auth_token", "api_key", "apikey", "bearer", "authorization"}
)
"""Query parameters in which someone may want to send a token: URLs end in logs and histories."""
MAX_BODY = 64 * 1024
GUARDS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
"""Headers of every reply: what a browser must not do with it."""
POLICY_VIOLATION = 1008
"""The close code of a WebSocket that is refused; before it is accepted, the server says 403."""
ANYBODY = Principal("anybody", Role.READ)
"""Whoever asks for what is public without a token."""
HANG_UP = {"Connection": "close"}
"""For a request whose rest is not worth waiting for."""
_LOOKED_AT = frozenset(
    {
        b"host",
        b"origin",
        b"sec-fetch-site",
        b"sec-fetch-mode",
        b"authorization",
        b"content-type",
        b"content-length",
    }
)


@dataclass(frozen=True, slots=True)
class Policy:
    """What the middleware checks against."""

    hosts: frozenset[str]
    """Values of the Host header that are ours, in lower case."""
    origins: frozenset[str]
    """Origins of pages that may send requests, in lower case."""
    tokens: Tokens
    requests_per_second: float | None
    """Of one client, stops excepted; None: as many as it likes."""
    request_timeout: float
    """Seconds in which a body must be here."""
    uploads: Uploads
    """How the bodies of the few paths are taken that may be larger."""

    @classmethod
    def of(cls, server: ServerSettings, trajectories: TrajectorySettings | None = None) -> Policy:
        """Loopback names with our port, the address that we listen on, and what the settings add.

        Raises `SettingsError` if the tokens can't be read.
        """
        trajectories = trajectories or TrajectorySettings()
        port = server.port
        hosts = {f"127.0.0.1:{port}", f"localhost:{port}", f"[::1]:{port}"}
        if server.host not in ("0.0.0.0", "::"):
            hosts.add(f"[{server.host}]:{port}" if ":" in server.host else f"{server.host}:{port}")
        hosts |= set(_with_port(server.allowed_hosts, port))
        own = {f"http://{host}" for host in hosts} | {f"https://{host}" for host in hosts}
        return cls(
            hosts=frozenset(host.lower() for host in hosts),
            origins=frozenset(o.lower().rstrip("/") for o in own | set(server.allowed_origins)) - {"null"},
            tokens=Tokens.of(server),
            requests_per_second=server.requests_per_second,
            request_timeout=server.request_timeout,
            uploads=Uploads(
                max_bytes=trajectories.max_bytes,
                idle_timeout=server.request_timeout,
                total_timeout=trajectories.upload_timeout,
                folder=trajectories.folder,
            ),
        )


def _with_port(hosts: Iterable[str], port: int) -> Iterable[str]:
    """A host without a port stands for itself (behind a proxy on 80 or 443) and for itself with our port."""
    for host in hosts:
        yield host
        if ":" not in host.rpartition("]")[2]:
            yield f"{host}:{port}"


class Head:
    """The headers that are looked at, found in one pass: this is done for every status request."""

    __slots__ = ("_values",)

    def __init__(self, scope: Scope) -> None:
        self._values: dict[bytes, list[str]] = {}
        for name, value in scope["headers"]:
            if name in _LOOKED_AT:
                self._values.setdefault(name, []).append(value.decode("latin-1"))

    def all(self, name: bytes) -> list[str]:
        """Every value of a header."""
        return self._values.get(name, [])

    def first(self, name: bytes) -> str:
        """Its first value; empty if there is none."""
        values = self._values.get(name)
        return values[0] if values else ""


class SecurityMiddleware:
    """Checks every request, and notes in the scope's state who sent it (`principal`).

    Reads the body of unsafe ones so that what follows can't be cut off by the client.
    """

    def __init__(self, app: ASGIApp, policy: Policy, tickets: Tickets) -> None:
        self.app = app
        self.policy = policy
        self.tickets = tickets
        rate = policy.requests_per_second
        self._rate = None if rate is None else RateLimit(rate)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a problem."""
        if scope["type"] == "http":
            await self._http(scope, receive, _guarded(send))
        elif scope["type"] == "websocket":
            await self._websocket(scope, receive, send)
        else:
            await self.app(scope, receive, send)

    async def _http(self, scope: Scope, receive: Receive, send: Send) -> None:
        method: str = scope["method"]
        head = Head(scope)
        try:
            self._admit(scope, head, method)
            if method == "POST" and scope["path"] in UPLOADS:
                scope["state"]["upload"] = await self._take_upload(scope["path"], receive, head)
                receive = _replay(b"", receive)
            elif method not in SAFE_METHODS:
                body = await self._read_body(receive, head)
                _check_content_type(scope["path"], head, body)
                receive = _replay(body, receive)
        except Refusal as refusal:
            await refuse(scope, receive, send, refusal.reply, refusal.headers)
            return
        except ClientGone:
            return
        if (upload := scope.get("state", {}).get("upload")) is not None:
            with upload.file:
                await self.app(scope, receive, send)
            return
        if method == "HEAD" and scope["path"] not in STREAM_PATHS:  # a GET, whose body the server leaves out
            scope = {**scope, "method": "GET"}
        await self.app(scope, receive, send)

    async def _websocket(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The same checks, before the WebSocket is accepted: no browser asks for leave (CORS) to open one."""
        try:
            self._admit(scope, Head(scope), WEBSOCKET)
        except Refusal as refusal:
            reason = str(refusal.reply.body["code"])
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
            return
        await self.app(scope, receive, send)

    def _admit(self, scope: Scope, head: Head, method: str) -> None:
        """Raises `Refusal`. What is cheap and tells nothing comes first."""
        self._check_host(head)
        self._check_origin(head)
        self._check_rate(scope)
        principal = self._principal(scope, head, method)
        scope.setdefault("state", {})["principal"] = principal
        needed = role_for(method, scope["path"])
        if principal.role < needed:
            raise Refusal(
                problem(
                    "forbidden_role",
                    f"This needs the role {needed.word}; {principal.name} has {principal.role.word}.",
                )
            )

    def _check_host(self, head: Head) -> None:
        hosts = head.all(b"host")
        if len(hosts) != 1 or hosts[0].lower() not in self.policy.hosts:
            shown = hosts[0][:100] if hosts else ""
            raise Refusal(problem("misdirected", f"This service doesn't answer for the host {shown!r}."))

    def _check_origin(self, head: Head) -> None:
        """A page of elsewhere may link to us, no more: reading costs the bus something too."""
        origins = head.all(b"origin")
        for origin in origins:
            if origin.lower() not in self.policy.origins:
                raise Refusal(
                    problem("forbidden_origin", f"Pages of {origin[:100]!r} may not use this service.")
                )
        if not origins and head.first(b"sec-fetch-site") == "cross-site":
            mode = head.first(b"sec-fetch-mode")
            if mode != "navigate":
                raise Refusal(problem("forbidden_origin", "Pages of other sites may not use this service."))

    def _check_rate(self, scope: Scope) -> None:
        if self._rate is None or is_stop(scope["path"]) or is_cancel(scope["path"]):
            return
        client: tuple[str, int] | None = scope.get("client")
        delay = self._rate.delay(client[0] if client else "")
        if delay > 0:
            raise Refusal(
                problem(
                    "too_many_requests",
                    f"More than {self.policy.requests_per_second:g} requests a second.",
                    retry_after=delay,
                )
            )

    def _principal(self, scope: Scope, head: Head, method: str) -> Principal:
        path: str = scope["path"]
        ticket = None
        if scope.get("query_string"):
            query = dict(parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True))
            if not TOKEN_PARAMETERS.isdisjoint(name.lower() for name in query):
                raise Refusal(problem("token_in_url", "The URL carries a token, or what looks like one."))
            if method == WEBSOCKET or path in STREAM_PATHS:
                ticket = query.get("ticket")
        if not self.policy.tokens:
            return LOCAL
        scheme, _, token = head.first(b"authorization").partition(" ")
        if scheme.lower() == "bearer":
            holder = self.policy.tokens.holder_of(token.strip())
        else:
            holder = None if ticket is None else self.tickets.redeem(ticket)
        if holder is not None:
            return holder
        if method in SAFE_METHODS and (path in PUBLIC_PATHS or path.startswith(PUBLIC_FOLDERS)):
            return ANYBODY
        raise Refusal(
            problem("unauthorized", "The request carries no valid token."),
            {"WWW-Authenticate": 'Bearer realm="canaxis"'},
        )

    async def _take_upload(self, path: str, receive: Receive, head: Head) -> Upload:
        """The body of a path of `UPLOADS`, in a file. All else is as for any command. Raises `Refusal`."""
        media_type = _media_type(head)
        if media_type not in UPLOADS[path]:
            taken = " or ".join(UPLOADS[path])
            raise Refusal(
                problem("media_type_unknown", f"This path takes {taken}, not {media_type[:60]!r}."), HANG_UP
            )
        return await self.policy.uploads.take(receive, media_type, _declared(head))

    async def _read_body(self, receive: Receive, head: Head) -> bytes:
        """The whole body. Raises `Refusal` as soon as it is known to be too large (413) or too slow (408)."""
        declared = _declared(head)
        if declared is not None and declared > MAX_BODY:
            raise _too_large()
        try:
            async with asyncio.timeout(self.policy.request_timeout):
                return await _whole(receive)
        except TimeoutError:
            raise Refusal(
                problem("request_timeout", f"The body was not here after {self.policy.request_timeout:g} s."),
                HANG_UP,
            ) from None


def _declared(head: Head) -> int | None:
    """The length that a body is said to have."""
    text = head.first(b"content-length")
    return int(text[:20]) if text.isascii() and text.isdigit() else None


def _media_type(head: Head) -> str:
    return head.first(b"content-type").partition(";")[0].strip().lower()


def _too_large() -> Refusal:
    return Refusal(problem("body_too_large", f"The body is larger than {MAX_BODY} bytes."), HANG_UP)


async def _whole(receive: Receive) -> bytes:
    chunks: list[bytes] = []
    size = 0
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientGone
        chunk: bytes = message.get("body", b"")
        size += len(chunk)
        if size > MAX_BODY:
            raise _too_large()
        chunks.append(chunk)
        if not message.get("more_body", False):
            return b"".join(chunks)


def _check_content_type(path: str, head: Head, body: bytes) -> None:
    if not body and is_stop(path):
        return  # stopping is the safe direction: a bare POST will do, whatever a tool declares it to be
    if _media_type(head) != JSON:
        raise Refusal(
            problem(
                "json_required", "A command needs the content type application/json, even without a body."
            )
        )


def _guarded(send: Send) -> Send:
    """A `send` that adds our headers for browsers."""

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *GUARDS]}
        await send(message)

    return guarded


def _replay(body: bytes, receive: Receive) -> Receive:
    """A `receive` that gives the body in one piece, then what the server says."""
    given = False

    async def replay() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return replay
