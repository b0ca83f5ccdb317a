"""Connections and WebSockets with bounds: uvicorn takes heads of any length, for any time, and any number.

No timer is set for a request, which would cost every one of them: the server looks at all connections once a
second.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from dataclasses import dataclass

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from app.configuration.configuration import ServerConfiguration

MAX_HEAD = 32 * 1024
"""Bytes of request line and headers, plus what came with the first of them."""
HUNG = 30.0
"""Seconds after which a client that takes no byte of its answer is let go."""
MAX_MESSAGE = 4096
"""Bytes of a message over a WebSocket; none needs more."""
PING = 20.0
"""Seconds between two pings over a WebSocket, and until one must be answered."""
TOO_SLOW = b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"


@dataclass(frozen=True, slots=True)
class Limits:
    """What connections must keep to."""

    connections: int
    head_timeout: float
    """Seconds from the connection, or from the first byte of a further request, to the end of the head."""


class BoundedHttp(HttpToolsProtocol):
    """A connection that is closed when its client is too slow or says too much."""

    limits = Limits(connections=512, head_timeout=10.0)
    _in_head = True
    _head = 0
    _head_since: float | None = None
    _stuck_since: float | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:
        """A client connected: its request must come soon. If there are too many, another makes room."""
        super().connection_made(transport)
        self._head_since = self.loop.time()
        if len(self.connections) > self.limits.connections:
            self._make_room()

    def on_message_begin(self) -> None:
        """A request begins."""
        super().on_message_begin()
        self._in_head, self._head = True, 0

    def on_headers_complete(self) -> None:
        """The rest is body, which the application bounds."""
        self._in_head = False
        self._head_since = None
        super().on_headers_complete()

    def data_received(self, data: bytes) -> None:
        """Count what belongs to an unfinished head; refuse and hang up when it is too much."""
        if self._head_since is None and not self._busy:
            self._head_since = self.loop.time()
        began_in_head = self._in_head
        super().data_received(data)
        if began_in_head and self._in_head:
            self._head += len(data)
            if self._head > MAX_HEAD and not self.transport.is_closing():
                self.send_400_response("The head of the request is too large.")

    def pause_writing(self) -> None:
        """The client doesn't take its answer."""
        self._stuck_since = self.loop.time()
        super().pause_writing()

    def resume_writing(self) -> None:
        """It does again."""
        self._stuck_since = None
        super().resume_writing()

    def look(self, now: float) -> None:
        """Hang up if the client is too slow."""
        if self._stuck_since is not None and now - self._stuck_since > HUNG:
            self.transport.abort()
        elif self._head_since is not None and now - self._head_since > self.limits.head_timeout:
            if not self._busy:
                self.transport.write(TOO_SLOW)
            self.transport.close()

    @property
    def _busy(self) -> bool:
        """Whether a request is being answered."""
        return bool(self.cycle) and not self.cycle.response_complete

    def _make_room(self) -> None:
        """Let the oldest go that hasn't said what it wants, else one that rests; else the newcomer."""
        others = [c for c in self.connections if isinstance(c, BoundedHttp) and c is not self and not c._busy]
        victim = min(others, key=lambda c: (c._head_since is None, c._head_since or 0.0), default=self)
        self.connections.discard(victim)  # at once: closing takes its turn
        victim.transport.close()


class BoundedWebSocket(WebSocketsSansIOProtocol):
    """A WebSocket whose client is let go when it takes nothing: a close would wait behind what it doesn't
    take.
    """

    _stuck_since: float | None = None

    def pause_writing(self) -> None:
        """The client doesn't take what is sent."""
        self._stuck_since = self.loop.time()
        super().pause_writing()

    def resume_writing(self) -> None:
        """It does again."""
        self._stuck_since = None
        super().resume_writing()

    def look(self, now: float) -> None:
        """Hang up if the client is too slow."""
        if self._stuck_since is not None and now - self._stuck_since > HUNG:
            self.transport.abort()


def bounded_http(server: ServerConfiguration) -> type[BoundedHttp]:
    """The protocol for the server, with the limits of the settings."""
    limits = Limits(connections=server.max_connections, head_timeout=server.request_timeout)
    return type("BoundedHttp", (BoundedHttp,), {"limits": limits})


def look_at(connections: Iterable[object], now: float) -> None:
    """Hang up on those clients that are too slow."""
    for connection in tuple(connections):
        if isinstance(connection, BoundedHttp | BoundedWebSocket):
            connection.look(now)
