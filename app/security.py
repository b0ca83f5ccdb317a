"""Who may speak to the service: a pure ASGI middleware in front of everything else.

It refuses foreign Host headers (DNS rebinding), what a browser sends for a page of elsewhere, commands that
are not declared to be JSON (so that such a page moves no motor even if the browser hides where it is from),
requests without the token where one is set, and large bodies. CORS stays off, and no page may frame ours: a
click in the documentation moves motors too.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterable
from dataclasses import dataclass

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.problems import ProblemReply, problem
from app.replies import refuse
from app.settings import ServerSettings

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
DOCS_ASSETS = "/docs/assets"
"""Where the interactive documentation's own script and style are: a lab's network may have no way out."""
PUBLIC_PATHS = frozenset({"/livez", "/readyz", "/docs", "/openapi.json"})
PUBLIC_FOLDERS = ("/problems/", f"{DOCS_ASSETS}/")
MAX_BODY = 64 * 1024
GUARDS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
"""Headers of every reply: what a browser must not do with it."""


@dataclass(frozen=True, slots=True)
class Policy:
    """What the middleware checks against."""

    hosts: frozenset[str]
    """Values of the Host header that are ours, in lower case."""
    origins: frozenset[str]
    """Origins of pages that may send requests, in lower case."""
    token_sha256: bytes | None
    """Hash of the bearer token, or None where none is needed."""

    @classmethod
    def of(cls, server: ServerSettings) -> Policy:
        """Loopback names with our port, the address that we listen on, and what the settings add."""
        port = server.port
        hosts = {f"127.0.0.1:{port}", f"localhost:{port}", f"[::1]:{port}"}
        if server.host not in ("0.0.0.0", "::"):
            hosts.add(f"[{server.host}]:{port}" if ":" in server.host else f"{server.host}:{port}")
        hosts |= set(_with_port(server.allowed_hosts, port))
        own = {f"http://{host}" for host in hosts} | {f"https://{host}" for host in hosts}
        token = server.read_token()
        return cls(
            hosts=frozenset(host.lower() for host in hosts),
            origins=frozenset(o.lower().rstrip("/") for o in own | set(server.allowed_origins)) - {"null"},
            token_sha256=None if token is None else hashlib.sha256(token.encode()).digest(),
        )


def _with_port(hosts: Iterable[str], port: int) -> Iterable[str]:
    """A host without a port stands for itself (behind a proxy on 80 or 443) and for itself with our port."""
    for host in hosts:
        yield host
        if ":" not in host.rpartition("]")[2]:
            yield f"{host}:{port}"


def is_stop(path: str) -> bool:
    """Whether a path stops something: one axis, or everything."""
    return path.endswith(("/stop", "/quick-stop"))


class Refusal(Exception):
    """The request ends here, with this reply."""

    def __init__(self, reply: ProblemReply, headers: dict[str, str] | None = None) -> None:
        super().__init__(reply.body["detail"])
        self.reply = reply
        self.headers = headers


class ClientGone(Exception):
    """The client left before its request was whole: there is nothing to carry out."""


class SecurityMiddleware:
    """Checks every request.

    Reads the body of unsafe ones so that what follows can't be cut off by the client.
    """

    def __init__(self, app: ASGIApp, policy: Policy) -> None:
        self.app = app
        self.policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a problem."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":  # none is served yet: closed before it is accepted, whoever asks
            await send({"type": "websocket.close", "code": 1008, "reason": ""})
        else:
            await self._http(scope, receive, send)

    async def _http(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope)
        unsafe = scope["method"] not in SAFE_METHODS
        send = _guarded(send)
        try:
            self._check_host(headers)
            self._check_origin(headers)
            self._check_token(scope["path"], headers)
            if unsafe:
                body = await _read_body(receive, headers)
                _check_content_type(scope["path"], headers, body)
                receive = _replay(body, receive)
        except Refusal as refusal:
            await refuse(scope, receive, send, refusal.reply, refusal.headers)
            return
        except ClientGone:
            return
        await self.app(scope, receive, send)

    def _check_host(self, headers: Headers) -> None:
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self.policy.hosts:
            shown = hosts[0][:100] if hosts else ""
            raise Refusal(problem("misdirected", f"This service doesn't answer for the host {shown!r}."))

    def _check_origin(self, headers: Headers) -> None:
        """A page of elsewhere may link to us, no more: reading costs the bus something too."""
        origins = headers.getlist("origin")
        for origin in origins:
            if origin.lower() not in self.policy.origins:
                raise Refusal(
                    problem("forbidden_origin", f"Pages of {origin[:100]!r} may not use this service.")
                )
        site, mode = headers.get("sec-fetch-site"), headers.get("sec-fetch-mode")
        if not origins and site == "cross-site" and mode != "navigate":
            raise Refusal(problem("forbidden_origin", "Pages of other sites may not use this service."))

    def _check_token(self, path: str, headers: Headers) -> None:
        wanted = self.policy.token_sha256
        if wanted is None or path in PUBLIC_PATHS or path.startswith(PUBLIC_FOLDERS):
            return
        scheme, _, token = headers.get("authorization", "").partition(" ")
        given = hashlib.sha256(token.strip().encode("latin-1", "replace")).digest()
        if not hmac.compare_digest(given, wanted) or scheme.lower() != "bearer":
            raise Refusal(
                problem("unauthorized", "The request carries no valid token."),
                {"WWW-Authenticate": 'Bearer realm="canaxis"'},
            )


def _check_content_type(path: str, headers: Headers, body: bytes) -> None:
    if not body and is_stop(path):
        return  # stopping is the safe direction: a bare POST will do, whatever a tool declares it to be
    content_type = headers.get("content-type")
    if content_type is None or content_type.partition(";")[0].strip().lower() != "application/json":
        raise Refusal(
            problem(
                "json_required", "A command needs the content type application/json, even without a body."
            )
        )


async def _read_body(receive: Receive, headers: Headers) -> bytes:
    """The whole body. Raises `Refusal` (413) as soon as it is known to be too large."""
    declared = headers.get("content-length", "0")
    if declared.isascii() and declared.isdigit() and int(declared[:20]) > MAX_BODY:
        raise Refusal(problem("body_too_large", f"The body is larger than {MAX_BODY} bytes."))
    chunks: list[bytes] = []
    size = 0
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientGone
        chunk: bytes = message.get("body", b"")
        size += len(chunk)
        if size > MAX_BODY:
            raise Refusal(problem("body_too_large", f"The body is larger than {MAX_BODY} bytes."))
        chunks.append(chunk)
        if not message.get("more_body", False):
            return b"".join(chunks)


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
