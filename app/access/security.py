"""Who may speak to the service: a pure ASGI middleware in front of everything else.

It refuses foreign Host headers (DNS rebinding), what a browser sends for a page of elsewhere, clients that
ask too often, tokens that are missing, wrong, or not entitled to the command, commands that are not declared
to be JSON (so that a page of elsewhere moves no motor even if the browser hides where it is from), and bodies
that are too large or too slow. CORS stays off, and no page may frame ours: a click in the documentation moves
motors too.
"""

from __future__ import annotations

from urllib.parse import parse_qsl

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.bodies import HANG_UP, check_content_type, read_body, replay
from app.access.head import Head
from app.access.policy import Policy
from app.access.roles import WEBSOCKET, Role, is_cancel, is_stop, role_for
from app.access.tickets import Tickets
from app.access.tokens import LOCAL, Principal
from app.http.paths import API, SAFE_METHODS
from app.http.problems import problem
from app.http.rates import RateLimit
from app.http.replies import ClientGone, Refusal, refuse
from app.http.uploads import UPLOADS, Upload

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
                receive = replay(b"", receive)
            elif method not in SAFE_METHODS:
                body = await read_body(receive, head, self.policy.request_timeout)
                check_content_type(scope["path"], head, body)
                receive = replay(body, receive)
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
        media_type = head.media_type
        if media_type not in UPLOADS[path]:
            taken = " or ".join(UPLOADS[path])
            raise Refusal(
                problem("media_type_unknown", f"This path takes {taken}, not {media_type[:60]!r}."), HANG_UP
            )
        return await self.policy.uploads.take(receive, media_type, head.length)


def _guarded(send: Send) -> Send:
    """A `send` that adds our headers for browsers."""

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *GUARDS]}
        await send(message)

    return guarded
