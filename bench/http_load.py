"""An HTTP client that is light enough to share a machine with what it measures."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

HEAD_END = b"\r\n\r\n"


class Connection(asyncio.Protocol):
    """One keep-alive connection; one request at a time."""

    def __init__(self) -> None:
        self._transport: asyncio.Transport | None = None
        self._answer: asyncio.Future[bytes] | None = None
        self._received = b""
        self._wanted = -1

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Connected."""
        self._transport = cast("asyncio.Transport", transport)

    def data_received(self, data: bytes) -> None:
        """Gather an answer: its head, and as many bytes as that says."""
        self._received += data
        if self._wanted < 0:
            head, end, _ = self._received.partition(HEAD_END)
            if not end:
                return
            at = head.lower().find(b"content-length:")
            length = 0 if at < 0 else int(head[at + 15 :].split(b"\r\n", 1)[0])
            self._wanted = len(head) + len(HEAD_END) + length
        if len(self._received) >= self._wanted and self._answer is not None:
            answer, self._answer = self._answer, None
            received, self._received, self._wanted = self._received, b"", -1
            if not answer.done():
                answer.set_result(received)

    def connection_lost(self, exc: Exception | None) -> None:
        """A server that hangs up spoils the measurement."""
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(exc or ConnectionError("the server closed the connection"))

    def send(self, request: bytes) -> asyncio.Future[bytes]:
        """Send a request; the future gets the whole answer."""
        assert self._transport is not None
        assert self._answer is None
        self._answer = asyncio.get_running_loop().create_future()
        self._transport.write(request)
        return self._answer

    def close(self) -> None:
        """Hang up."""
        if self._transport is not None:
            self._transport.close()


@dataclass(frozen=True, slots=True)
class Address:
    """Where the server is."""

    host: str
    port: int

    @classmethod
    def of(cls, url: str) -> Address:
        """From http://HOST:PORT."""
        host, _, port = url.removeprefix("http://").partition(":")
        return cls(host, int(port))

    async def connect(self) -> Connection:
        """A connection."""
        loop = asyncio.get_running_loop()
        _, connection = await loop.create_connection(Connection, self.host, self.port)
        return connection

    def request(self, method: str, path: str, body: bytes = b"") -> bytes:
        """A request as bytes."""
        kind = f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n" if method != "GET" else ""
        return f"{method} {path} HTTP/1.1\r\nHost: {self.host}:{self.port}\r\n{kind}\r\n".encode() + body


def check(answer: bytes, status: int = 200) -> bytes:
    """The body of an answer that went well; anything else ends the measurement."""
    head, _, body = answer.partition(HEAD_END)
    if int(head[9:12]) != status:
        raise RuntimeError(answer.decode(errors="replace"))
    return body


@dataclass(slots=True)
class Load:
    """Requests on a fixed schedule, whether the answers come in time or not."""

    address: Address
    paths: Sequence[str]
    rate: float
    """Requests a second."""
    connections: int = 16
    latencies: list[float] = field(default_factory=list[float])
    """Seconds from the sending of each request to the whole of its answer.

    The wait for a free connection isn't in it: on a machine whose time is taken away it would measure that.
    """
    sent: int = 0
    _end: asyncio.Event = field(default_factory=asyncio.Event)

    async def run(self, seconds: float | None = None) -> None:
        """Keep the schedule for some time, or until `end`."""
        loop = asyncio.get_running_loop()
        requests = [self.address.request("GET", path) for path in self.paths]
        free = deque([await self.address.connect() for _ in range(self.connections)])
        busy: set[asyncio.Future[bytes]] = set()
        every = list(free)

        def begin(request: bytes) -> None:
            connection = free.popleft()
            began = time.perf_counter()
            answer = connection.send(request)
            busy.add(answer)

            def done(answer: asyncio.Future[bytes]) -> None:
                check(answer.result())
                self.latencies.append(time.perf_counter() - began)
                busy.discard(answer)
                free.append(connection)

            answer.add_done_callback(done)

        start = loop.time()
        try:
            while not self._end.is_set() and (seconds is None or loop.time() < start + seconds):
                due = int((loop.time() - start) * self.rate)
                while self.sent < due and free:
                    begin(requests[self.sent % len(requests)])
                    self.sent += 1
                await asyncio.sleep(max(0.0, start + (self.sent + 1) / self.rate - loop.time()))
            if busy:
                await asyncio.wait(busy, timeout=10)
        finally:
            for connection in every:
                connection.close()

    def end(self) -> None:
        """Send no more."""
        self._end.set()
