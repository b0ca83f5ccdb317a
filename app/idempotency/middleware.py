"""`Idempotency-Key`: a command that is sent twice is carried out once, over restarts of the service too.

A key is spent as soon as a command has begun. What was refused before anything was sent (4xx, and 503) leaves
it free, so that the same request may be tried again once the reason is gone. Stop commands are never held
back by a key: they are idempotent by nature, and a stop that is answered from memory would not stop.

Each holder of a token has keys of its own. Whoever carries a command out finds the key's `Claim` in the
scope's state and spends it before the first frame: see `app/idempotency/keys.py`.
"""

from __future__ import annotations

import asyncio
import hashlib

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.roles import is_stop
from app.access.tokens import LOCAL, Principal
from app.http.parameters import KEY
from app.http.paths import SAFE_METHODS
from app.http.problems import problem
from app.http.replies import problem_response, refuse
from app.http.uploads import Upload
from app.idempotency.keys import Claim, Keys, Record
from app.store.database import StoreOff

LONGEST_KEY = 255


class IdempotencyMiddleware:
    """Looks at the key of every command; the body was read whole by the middleware before this one."""

    def __init__(self, app: ASGIApp, keys: Keys) -> None:
        self.app = app
        self.keys = keys

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Carry out, replay, or refuse."""
        key = None
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS and not is_stop(scope["path"]):
            key = Headers(scope=scope).get(KEY)
        if key is None:
            await self.app(scope, receive, send)
            return
        if not 0 < len(key) <= LONGEST_KEY:
            reply = problem("bad_request", f"Idempotency-Key must have 1 to {LONGEST_KEY} characters.")
            await refuse(scope, receive, send, reply)
            return
        first = await receive()
        body: bytes = first.get("body", b"")
        fingerprint = _fingerprint(scope, body)
        key = _scoped(scope, key)
        try:
            record = await self.keys.find(key)
        except StoreOff as off:
            reply = problem("history_off", f"What became of this Idempotency-Key can't be read: {off}")
            await refuse(scope, receive, send, reply)
            return
        if record is None:
            claim = self.keys.begin(key, fingerprint)
            await self._carry_out(scope, _again(first, receive), send, claim)
        elif record.fingerprint != fingerprint:
            reply = problem("key_reused", "This Idempotency-Key was sent with another request.")
            await refuse(scope, receive, send, reply)
        elif not record.answered:
            reply = problem(
                "key_in_flight", "The first request with this Idempotency-Key is not answered yet."
            )
            await refuse(scope, receive, send, reply)
        else:
            await _replay(record, send)

    async def _carry_out(self, scope: Scope, receive: Receive, send: Send, claim: Claim) -> None:
        scope.setdefault("state", {})["claim"] = claim
        status = 500
        headers: list[tuple[bytes, bytes]] = []
        chunks: list[bytes] = []

        async def watch(message: Message) -> None:
            nonlocal status, headers
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = list(message.get("headers", []))
            elif message["type"] == "http.response.body":
                chunks.append(message.get("body", b""))
                if not message.get("more_body", False):
                    self.keys.settle(claim, status, headers, b"".join(chunks))
            await send(message)

        try:
            await self.app(scope, receive, watch)
        except (Exception, asyncio.CancelledError):
            # If it has begun, the key is spent, and the answer is that nobody knows.
            reply = problem("internal_error", "The first request with this Idempotency-Key broke off.")
            response = problem_response(reply, instance=scope["path"])
            self.keys.settle(claim, reply.status, response.raw_headers, bytes(response.body))
            raise


def _scoped(scope: Scope, key: str) -> str:
    """The key among those of its sender: two clients that chose the same one don't meet."""
    principal: Principal = scope.get("state", {}).get("principal", LOCAL)
    return f"{principal.name}:{key}"


def _fingerprint(scope: Scope, body: bytes) -> bytes:
    upload: Upload | None = scope.get("state", {}).get("upload")
    if upload is not None:  # hashed as it came
        body = upload.media_type.encode("latin-1") + upload.digest
    digest = hashlib.sha256()
    for part in (scope["method"].encode(), scope["path"].encode(), scope.get("query_string", b""), body):
        digest.update(len(part).to_bytes(4, "big"))
        digest.update(part)
    return digest.digest()


def _again(first: Message, receive: Receive) -> Receive:
    """A `receive` that gives the first message once more, then what follows."""
    given = False

    async def again() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return first

    return again


async def _replay(record: Record, send: Send) -> None:
    headers = MutableHeaders(raw=list(record.headers))
    headers["Idempotent-Replayed"] = "true"
    await send({"type": "http.response.start", "status": record.status, "headers": headers.raw})
    await send({"type": "http.response.body", "body": record.body})
