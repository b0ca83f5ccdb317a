"""`Idempotency-Key`: a command that is sent twice is carried out once.

A key is spent as soon as a command has begun. What was refused before anything was sent (4xx, and 503) leaves
it free, so that the same request may be tried again once the reason is gone. Stop commands are never held
back by a key: they are idempotent by nature, and a stop that is answered from memory would not stop.
"""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.problems import problem
from app.replies import problem_response, refuse
from app.roles import SAFE_METHODS, is_stop

HEADER = "idempotency-key"
LONGEST_KEY = 255
LIFETIME = 24 * 3600.0
CAPACITY = 10_000


@dataclass(slots=True)
class Record:
    """A key, the request that it was sent with, and the answer once there is one."""

    fingerprint: bytes
    born: float
    status: int | None = None
    headers: list[tuple[bytes, bytes]] = field(default_factory=list[tuple[bytes, bytes]])
    body: bytes = b""

    @property
    def answered(self) -> bool:
        """Whether the answer is known."""
        return self.status is not None


class KeyStore(Protocol):
    """Where keys are kept. In memory now; a store that outlives the process fits in the same place."""

    def find(self, key: str) -> Record | None:
        """The record of a key that is not yet too old."""
        ...

    def begin(self, key: str, fingerprint: bytes) -> Record:
        """Note that a request with this key begins."""
        ...

    def keep(self, key: str, record: Record) -> None:
        """Note its answer."""
        ...

    def forget(self, key: str) -> None:
        """Free the key: nothing was carried out."""
        ...


class MemoryKeys:
    """Keys of the last 24 hours, at most `CAPACITY`; those in flight are never pushed out."""

    def __init__(
        self, capacity: int = CAPACITY, lifetime: float = LIFETIME, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._capacity = capacity
        self._lifetime = lifetime
        self._now = now
        self._records: OrderedDict[str, Record] = OrderedDict()

    def find(self, key: str) -> Record | None:
        """The record of a key that is not yet too old."""
        record = self._records.get(key)
        if record is not None and record.answered and self._now() - record.born > self._lifetime:
            del self._records[key]
            return None
        return record

    def begin(self, key: str, fingerprint: bytes) -> Record:
        """Note that a request with this key begins; the oldest answered key goes if there are too many."""
        record = self._records[key] = Record(fingerprint, self._now())
        if len(self._records) > self._capacity:
            oldest = next((k for k, r in self._records.items() if r.answered), None)
            if oldest is not None:
                del self._records[oldest]
        return record

    def keep(self, key: str, record: Record) -> None:
        """Note its answer (it is in the record already)."""
        self._records[key] = record

    def forget(self, key: str) -> None:
        """Free the key."""
        self._records.pop(key, None)


class IdempotencyMiddleware:
    """Looks at the key of every command; the body was read whole by the middleware before this one."""

    def __init__(self, app: ASGIApp, keys: KeyStore) -> None:
        self.app = app
        self.keys = keys

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Carry out, replay, or refuse."""
        key = None
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS and not is_stop(scope["path"]):
            key = Headers(scope=scope).get(HEADER)
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
        record = self.keys.find(key)
        if record is None:
            await self._carry_out(scope, _again(first, receive), send, key, fingerprint)
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

    async def _carry_out(
        self, scope: Scope, receive: Receive, send: Send, key: str, fingerprint: bytes
    ) -> None:
        record = self.keys.begin(key, fingerprint)
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
                    self._settle(key, record, status, headers, b"".join(chunks))
            await send(message)

        try:
            await self.app(scope, receive, watch)
        except (Exception, asyncio.CancelledError):
            if (
                not record.answered
            ):  # it may have begun: the key is spent, and the answer is that nobody knows
                reply = problem("internal_error", "The first request with this Idempotency-Key broke off.")
                response = problem_response(reply, instance=scope["path"])
                self._settle(key, record, reply.status, response.raw_headers, bytes(response.body))
            raise

    def _settle(
        self, key: str, record: Record, status: int, headers: list[tuple[bytes, bytes]], body: bytes
    ) -> None:
        if 400 <= status < 500 or status == 503:
            self.keys.forget(key)
            return
        record.headers, record.body, record.status = headers, body, status
        self.keys.keep(key, record)


def _fingerprint(scope: Scope, body: bytes) -> bytes:
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
