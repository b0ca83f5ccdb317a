"""Server-sent events: a snapshot first, then what changes.

Each event is encoded once and the same bytes go to every client. Each client has a bounded queue in the hub.
One that falls behind is told in a `missed` event how much it lost, and let go: it comes back with the id of
the last event that it got, and is given what is kept since. The response is a plain stream: anything richer
costs several times that.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections import OrderedDict
from collections.abc import AsyncGenerator, Callable, Iterator
from datetime import datetime
from typing import Any

from starlette.requests import ClientDisconnect
from starlette.responses import StreamingResponse
from starlette.types import Message, Receive, Scope, Send

from app.events.wire import Told
from app.http.problems import ApiError
from drivers.master.seen.events import Event, Subscription

KEEP_ALIVE = 15.0
"""Seconds of silence after which a comment keeps the connection open."""
PAUSE = 0.02
"""Seconds between two chunks to one client: of what changes faster, it gets the latest."""
CAPACITY = 256
"""How many events that must not be lost may wait for one client."""
HUNG = 30.0
"""Seconds after which a client that takes no byte is let go, so that it holds no place and no memory."""
RETRY = b"retry: 2000\n\n"
"""Tells a client how many milliseconds after a break to come back."""
ENCODED = 512
"""How many encoded events are kept for the other clients."""


def encode(kind: str, data: object, event_id: int | None = None) -> bytes:
    """One event as the bytes of a text/event-stream."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"), default=_plain)
    head = f"event: {kind}\n" if event_id is None else f"id: {event_id}\nevent: {kind}\n"
    return f"{head}data: {text}\n\n".encode()


def _plain(value: object) -> str:
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")  # as the replies to GET write it
    raise TypeError(f"{type(value).__name__} has no place in an event")


class EventStream(StreamingResponse):
    """A stream that gives back what it holds, however it ends."""

    def __init__(self, chunks: AsyncGenerator[bytes], release: Callable[[], None]) -> None:
        super().__init__(
            chunks,
            media_type="text/event-stream",
            headers={"Cache-Control": "no-cache", "X-Accel-Buffering": "no"},
        )
        self._chunks = chunks
        self._release = release

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the client goes, hangs, or the generator ends."""

        async def send_in_time(message: Message) -> None:
            async with asyncio.timeout(HUNG):
                await send(message)

        try:
            with contextlib.suppress(ClientDisconnect, TimeoutError):
                await super().__call__(scope, receive, send_in_time)
        finally:
            self._release()
            await self._chunks.aclose()


class Streams:
    """All open streams of the service, and the bytes that they share."""

    def __init__(self, told: Told, limit: int) -> None:
        """`limit`: how many may be open at once."""
        self._told = told
        self._hub = told.network.events
        self._limit = limit
        self._open: set[Subscription] = set()
        self._encoded: OrderedDict[int, bytes] = OrderedDict()
        self._closed = False
        self._missed = 0

    @property
    def missed(self) -> int:
        """Events that slow clients lost, all together."""
        return self._missed + sum(subscription.missed for subscription in self._open)

    def __len__(self) -> int:
        return len(self._open)

    def open(self, last_event_id: int | None) -> EventStream:
        """A new stream. Raises `ApiError` (503) if there are too many, or at shutdown."""
        if self._closed:
            raise ApiError("shutting_down", "The service is shutting down and opens no new stream.")
        if len(self._open) >= self._limit:
            raise ApiError("too_many_streams", f"{self._limit} event streams are open already.")
        subscription = self._hub.subscribe(CAPACITY)
        self._open.add(subscription)
        return EventStream(
            self._chunks(subscription, last_event_id), release=lambda: self._release(subscription)
        )

    def close(self) -> None:
        """End every stream."""
        self._closed = True
        for subscription in tuple(self._open):
            subscription.close()

    def _release(self, subscription: Subscription) -> None:
        if subscription in self._open:
            self._open.discard(subscription)
            self._missed += subscription.missed
            subscription.close()

    async def _chunks(self, subscription: Subscription, last_event_id: int | None) -> AsyncGenerator[bytes]:
        begun = self._hub.last_id
        yield self._beginning(last_event_id)
        while True:
            try:
                async with asyncio.timeout(KEEP_ALIVE):
                    event = await subscription.get()
            except TimeoutError:
                yield b": keep-alive\n\n"
                continue
            waiting = list(_waiting(subscription, event))
            chunk = b"".join(
                self._bytes_of(each) for each in waiting if each.id > begun or _tells_a_loss(each)
            )
            if chunk:
                yield chunk
            if event is None or any(map(_tells_a_loss, waiting)):
                return
            await asyncio.sleep(PAUSE)

    def _beginning(self, last_event_id: int | None) -> bytes:
        """The events that the client missed, as far as they are kept, then a snapshot of everything."""
        chunks = [RETRY]
        if last_event_id is not None:
            kept = self._hub.since(last_event_id)
            if kept is None:
                chunks.append(encode("missed", {"missed": None, "since": last_event_id}))
            else:
                chunks.extend(self._bytes_of(event) for event in kept)
        chunks.append(encode("snapshot", self._told.snapshot(), self._hub.last_id))
        return b"".join(chunks)

    def _bytes_of(self, event: Event) -> bytes:
        if _tells_a_loss(event):  # to this one client
            return encode("missed", dict(event.data))  # no id: it comes back with that of the last one it got
        known = self._encoded.get(event.id)
        if known is None:
            known = encode(event.kind, self._wire(event), event.id)
            self._encoded[event.id] = known
            if len(self._encoded) > ENCODED:
                self._encoded.popitem(last=False)
        return known

    def _wire(self, event: Event) -> dict[str, Any]:
        """What the event says to a client; the same shapes as in the replies to GET."""
        return {
            **self._told.news(event),
            "time": _plain(event.time),
            "node": event.node,
            "axis": event.axis,
        }


def _waiting(subscription: Subscription, first: Event | None) -> Iterator[Event]:
    """`first` and what waits behind it; nothing more after a loss, which is for the client's next stream."""
    event = subscription.take() if first is None else first
    while event is not None:
        yield event
        event = None if _tells_a_loss(event) else subscription.take()


def _tells_a_loss(event: Event) -> bool:
    return event.kind == "missed"
