"""A socketcand server on a memory wire: any program that speaks to the real daemon can join the bus.

Raw mode only, as python-can's ``socketcand`` interface uses it. Each client is a port of its own, so that
clients see each other's frames and take part in the arbitration. The texts are those of the daemon
(https://github.com/linux-can/socketcand, doc/protocol.md); where it keeps silent about a malformed command,
this server answers.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import cast

from drivers.bus.base import BusState
from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.errors import BusDown, BusError, BusOverflow

HOST = "127.0.0.1"
PORT = 29536
"""Where python-can's ``socketcand`` interface and the real daemon meet by default."""

HOLD_BACK = 0.1
"""Seconds for which frames wait after the ``< ok >`` of raw mode, or until the client's next command.

python-can's client takes everything that its first read after ``< rawmode >`` finds for the answer, and gives
up if that is more than ``< ok >``; a frame in the same TCP segment would cost it the connection.
"""
OUTPUT_LIMIT = 262_144
"""Bytes that may wait for a client that doesn't read (some 6000 frames); then it is disconnected."""
COMMAND_LIMIT = 256
"""Characters of the longest command; the longest that is valid has 44."""
ENDING = 0.2
"""Seconds that clients get to read what waits for them when the server is closed."""

_SEND = re.compile(r"send ([0-9A-Fa-f]{1,3}|[0-9A-Fa-f]{8}) ([0-8])((?: [0-9A-Fa-f]{1,2})*)")
_SEND_REMOTE = re.compile(r"sendrtr ([0-9A-Fa-f]{1,3}|[0-9A-Fa-f]{8}) ([0-8])")


@dataclass(frozen=True, slots=True)
class ServerCounters:
    """What happened at a server since it started; a snapshot."""

    accepted: int = 0
    """Connections."""
    malformed: int = 0
    """Commands that were not understood."""
    dropped: int = 0
    """Frames of clients for which the wire had no room."""
    cut_off: int = 0
    """Clients disconnected because they read too slowly."""


def parse_send(command: str) -> Frame | None:
    """The frame of a ``send`` or ``sendrtr`` command (without its angle brackets); None if it is malformed.

    A ``send`` with a length but no data is a remote request: python-can's client writes those like that.
    """
    if match := _SEND_REMOTE.fullmatch(command):
        data, remote = b"", True
    elif match := _SEND.fullmatch(command):
        data = bytes(int(byte, 16) for byte in match[3].split())
        length = int(match[2])
        remote = length > 0 and not data
        if not remote and len(data) != length:
            return None
    else:
        return None
    frame = Frame(int(match[1], 16), data, remote=remote, extended=len(match[1]) == 8)
    return frame if frame.is_sendable else None


def format_frame(frame: Frame, wall_clock: float) -> str:
    """The text that tells a client of a frame. `wall_clock` is in seconds since 1970.

    Clients tell standard from extended identifiers by their three or eight digits, and need both spaces of a
    frame without data.
    """
    if frame.error:
        return f"< error {frame.cob_id:03X} {wall_clock:.6f} >"
    identifier = f"{frame.cob_id:08X}" if frame.extended else f"{frame.cob_id:03X}"
    if frame.remote:
        return f"< rtr {identifier} {wall_clock:.6f} 0 >"
    return f"< frame {identifier} {wall_clock:.6f} {frame.data.hex().upper()} >"


class SocketcandServer:
    """Serves one wire under each of the names in `channels`, to any number of clients.

    `port` 0 takes a free one; see the property of that name. There is no authentication in the protocol: keep
    `host` a loopback address.
    """

    def __init__(
        self,
        wire: MemoryWire,
        *,
        host: str = HOST,
        port: int = PORT,
        channels: Collection[str] = ("can0", "vcan0"),
    ) -> None:
        self._wire = wire
        self._host = host
        self._port = port
        self._channels = frozenset(channels)
        self._server: asyncio.Server | None = None
        self._clients: set[_Client] = set()
        self._endings: set[asyncio.Task[None]] = set()
        self._accepted = 0
        self._malformed = 0
        self._dropped = 0
        self._cut_off = 0

    @property
    def port(self) -> int:
        """The TCP port; the one taken if 0 was asked for and the server runs."""
        return self._port

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients)

    @property
    def counters(self) -> ServerCounters:
        """What happened so far."""
        return ServerCounters(self._accepted, self._malformed, self._dropped, self._cut_off)

    async def start(self) -> None:
        """Listen. Raises `BusError` if the address can't be had."""
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(self._client, self._host, self._port)
        except OSError as error:
            raise BusError(
                f"can't listen on {self._host}:{self._port}: {error.strerror}",
                hint="Stop the server that runs there already, or choose another port.",
            ) from error
        self._port = self._server.sockets[0].getsockname()[1]

    async def close(self) -> None:
        """Disconnect everyone and stop listening. Idempotent."""
        if self._server is None:
            return
        server, self._server = self._server, None
        server.close()
        for client in tuple(self._clients):
            client.end()
        try:
            async with asyncio.timeout(ENDING):
                await asyncio.gather(*(client.ended.wait() for client in tuple(self._clients)))
        except TimeoutError:
            for client in tuple(self._clients):
                client.abort()
            await asyncio.gather(*(client.ended.wait() for client in tuple(self._clients)))
        await server.wait_closed()
        await asyncio.gather(*self._endings)

    # --- called by the clients

    def _client(self) -> _Client:
        return _Client(self)

    def joined(self, client: _Client) -> None:
        """A client has connected."""
        self._accepted += 1
        self._clients.add(client)

    def left(self, client: _Client, port: MemoryBus | None) -> None:
        """A client is gone; what it sent before still goes out."""
        self._clients.discard(client)
        if port is not None:
            ending = asyncio.get_running_loop().create_task(
                self._retire(port), name="retire socketcand client"
            )
            self._endings.add(ending)
            ending.add_done_callback(self._endings.discard)

    def open_channel(self, channel: str) -> MemoryBus | None:
        """A port for a client; None if there is no such channel."""
        if channel not in self._channels:
            return None
        port = self._wire.port(f"socketcand client {self._accepted}")
        port.join()
        return port

    def count_malformed(self) -> None:
        """A client sent what nobody understands."""
        self._malformed += 1

    def count_dropped(self) -> None:
        """A client's frame found no room."""
        self._dropped += 1

    def count_cut_off(self) -> None:
        """A client had to go because it doesn't read."""
        self._cut_off += 1

    async def _retire(self, port: MemoryBus) -> None:
        await port.close()
        self._wire.discard(port)


class _Client(asyncio.Protocol):
    """One connection: without a bus, then with a bus, then in raw mode."""

    def __init__(self, server: SocketcandServer) -> None:
        self.ended = asyncio.Event()
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._input = ""
        self._bus: MemoryBus | None = None
        self._unsubscribe: Callable[[], None] | None = None
        self._held: list[str] | None = None
        self._hold: asyncio.TimerHandle | None = None

    # --- the connection

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)  # uvloop's is no subclass of it
        self._server.joined(self)
        self._write("< hi >")

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self._transport = None
        if self._unsubscribe is not None:
            self._unsubscribe()
        if self._hold is not None:
            self._hold.cancel()
        self._server.left(self, self._bus)
        self._bus = None
        self.ended.set()

    def data_received(self, data: bytes) -> None:
        self._input += data.decode("latin-1")
        while (end := self._input.find(">")) >= 0:
            text, self._input = self._input[:end], self._input[end + 1 :]
            self._command(text)
            if self._transport is None or self._transport.is_closing():
                self._input = ""
        if len(self._input) > COMMAND_LIMIT:
            self._input = ""
            self._refuse("unknown command")

    def end(self) -> None:
        """Disconnect once the client has read what waits for it."""
        if self._transport is not None:
            self._transport.close()

    def abort(self) -> None:
        """Disconnect now."""
        if self._transport is not None:
            self._transport.abort()

    # --- commands

    def _command(self, text: str) -> None:
        self._let_go()  # whoever sends the next command has read the answer to the last
        before, bracket, command = text.partition("<")
        command = command.strip()
        if before.strip() or not bracket:
            self._refuse("unknown command")
        elif command == "echo":
            self._write("< echo >")
        elif self._bus is None:
            self._open(command)
        elif command.startswith(("send ", "sendrtr ")):
            self._send(self._bus, command)
        elif command == "rawmode":
            self._enter_raw_mode(self._bus)
        else:
            self._refuse("unknown command")

    def _open(self, command: str) -> None:
        if not command.startswith("open "):
            self._refuse("unknown command")
            return
        self._bus = self._server.open_channel(command.removeprefix("open ").strip())
        if self._bus is None:
            self._refuse("could not open bus")
            self.end()
        else:
            self._write("< ok >")

    def _enter_raw_mode(self, bus: MemoryBus) -> None:
        self._write("< ok >")
        if self._unsubscribe is None:
            self._held = []
            self._hold = asyncio.get_running_loop().call_later(HOLD_BACK, self._let_go)
            self._unsubscribe = bus.subscribe(self._on_frames, self._on_state)

    def _send(self, bus: MemoryBus, command: str) -> None:
        frame = parse_send(command)
        if frame is None:
            self._refuse("malformed send command")
            return
        try:
            bus.send(frame)
        except BusOverflow:
            self._server.count_dropped()
        except BusDown:
            self.end()  # as the daemon does when its interface goes

    def _refuse(self, reason: str) -> None:
        self._server.count_malformed()
        self._write(f"< error {reason} >")

    # --- frames

    def _on_frames(self, batch: Sequence[Frame]) -> None:
        now = time.time()
        texts = [format_frame(frame, now) for frame in batch]
        if self._held is not None:
            self._held.extend(texts)
        else:
            self._write("".join(texts))

    def _on_state(self, state: BusState, reason: str) -> None:
        del reason
        if state is BusState.DOWN:
            self.end()

    def _let_go(self) -> None:
        """Send what was held back."""
        if self._hold is not None:
            self._hold.cancel()
            self._hold = None
        held, self._held = self._held, None
        if held:
            self._write("".join(held))

    def _write(self, text: str) -> None:
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        transport.write(text.encode("ascii"))
        if transport.get_write_buffer_size() > OUTPUT_LIMIT:
            self._server.count_cut_off()
            transport.abort()
