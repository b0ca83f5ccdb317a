"""A `Bus` over any interface of python-can. The only file that imports it.

python-can reads and writes; when to do so, what waits, and what happens when the wire goes is
`SupervisedBus`'s.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import select
import socket
import struct
import sys
import threading
from typing import Any, cast

import can

from drivers.bus.base import Beside
from drivers.bus.blocking import in_thread
from drivers.bus.frame import Frame
from drivers.bus.probe import find_socketcan, find_socketcand, has_carrier
from drivers.bus.reader import Lost
from drivers.bus.supervised import Link, SupervisedBus
from drivers.errors import BadValue, BusDown

OPENING = 5.0
"""Seconds that python-can gets to open an interface."""
SHUTDOWN = 1.0
"""Seconds that python-can gets to close one."""
RECEIVE_BUFFER = 2 << 20
"""Bytes that the kernel is asked to hold for us: some 2000 frames, a fifth of a second of a full bus.

Its default of 208 KiB holds some 250 of them: with that, frames are lost when the loop is busy for 30 ms.
"""

SOCKETCAND_HOST = "127.0.0.1"
SOCKETCAND_PORT = 29536

_FULL = frozenset({errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK})

_TORN_BY_POLLING = frozenset({"serial", "seeedstudio"})
"""Interfaces with a descriptor that read one frame in several pieces: a zero timeout would tear it."""

_OURS = frozenset({"receive_own_messages", "can_filters"})
"""Options of python-can that this bus decides: it hears every frame of others, and none of its own."""


def interfaces() -> list[str]:
    """The interfaces that python-can knows here, plug-ins included."""
    return sorted(can.VALID_INTERFACES)


class PythonCanBus(SupervisedBus):
    """A CAN bus through python-can: `interface`, `channel`, `bitrate` and `options` are in its own words.

    For ``socketcand`` the server defaults to 127.0.0.1:29536 (options ``host``, ``port``). On ``socketcan``
    the bit rate is set by the system (``ip link``), so `bitrate` has no effect there. Raises `BadValue` for
    the options ``receive_own_messages`` and ``can_filters``, which are this class's own business.
    """

    def __init__(
        self, interface: str, channel: str | None = None, bitrate: int | None = None, **options: object
    ) -> None:
        if refused := _OURS & options.keys():
            raise BadValue(
                f"{', '.join(sorted(refused))} can't be chosen here", hint="Leave these options out."
            )
        self._interface = interface
        self._channel = channel
        self._options: dict[str, object] = dict(options)
        if bitrate is not None:
            self._options["bitrate"] = bitrate
        name = interface if channel is None else f"{interface}:{channel}"
        if interface == "socketcand":
            self._host = str(self._options.setdefault("host", SOCKETCAND_HOST))
            self._port = int(str(self._options.setdefault("port", SOCKETCAND_PORT)))
            self._options.setdefault("tcp_tune", os.name != "nt")
            name = f"{name}@{self._host}:{self._port}"
        super().__init__(name, self._connect_link)

    @property
    def beside(self) -> Beside | None:
        """See `Bus.beside`: SocketCAN and socketcand serve any number of programs."""
        if self._channel is None:
            return None
        if self._interface == "socketcand":
            return Beside("socketcand", self._channel, self._host, self._port)
        return Beside("socketcan", self._channel) if self._interface == "socketcan" else None

    async def _connect_link(self) -> Link:
        """Open the interface. Raises `BusDown` with what to do about it."""
        if self._interface == "socketcand":
            await find_socketcand(self._host, self._port)
        elif self._interface == "socketcan" and self._channel:
            find_socketcan(self._channel)
        try:
            async with asyncio.timeout(OPENING):
                bus = await in_thread(self._construct, abandon=can.BusABC.shutdown)
        except TimeoutError:
            raise BusDown(f"{self.name} did not open within {OPENING:g} s") from None
        except Exception as error:  # python-can's interfaces raise whatever their drivers do
            raise BusDown(f"{self.name} can't be opened: {_reason(error)}") from error
        link = _link(bus, self._interface, self._channel)
        try:
            link.check()
        except Lost as lost:
            await link.close()
            raise BusDown(
                f"{self.name} can't be used: {lost}",
                hint=f"Bring the link up: ip link set {self._channel} up type can bitrate 1000000",
            ) from None
        return link

    def _construct(self) -> can.BusABC:
        options = cast("dict[str, Any]", self._options)
        return can.Bus(channel=self._channel, interface=self._interface, **options)


class _Link:
    """One open interface of python-can, never reopened."""

    shows_all = False
    """See `Link.shows_all`: python-can may hold frames that it has read already."""

    def __init__(self, bus: can.BusABC, interface: str) -> None:
        self._bus = bus
        self._interface = interface
        self._clock = asyncio.get_running_loop().time
        self._reading = threading.Lock()
        self._closed = False

    @property
    def is_off(self) -> bool:
        """See `Link.is_off`: most interfaces don't tell."""
        return False

    @property
    def overrun(self) -> int:
        """See `Link.overrun`: most interfaces don't tell."""
        return 0

    def descriptor(self) -> int | None:
        """See `Link.descriptor`."""
        if self._interface in _TORN_BY_POLLING:
            return None
        try:
            return self._bus.fileno()
        except (NotImplementedError, can.CanError, OSError):
            return None

    def check(self) -> None:
        """Raise `Lost` if the fresh link can't carry anything."""

    def drain(self, into: list[Frame], limit: int) -> None:
        """See `Source.drain`."""
        for _ in range(limit):
            frame = self.receive(0)
            if frame is None:
                return
            into.append(frame)

    def receive(self, timeout: float) -> Frame | None:
        """See `Source.receive`. Frames longer than eight bytes (CAN FD) are passed over."""
        try:
            with self._reading:
                if self._closed:
                    return None
                message = self._bus.recv(timeout)
                while message is not None and message.is_fd:
                    message = self._bus.recv(0)
        except Exception as error:  # whatever the interface's driver raises, it can't be read any more
            raise Lost(_reason(error)) from error
        if message is None:
            return None
        return Frame(
            message.arbitration_id,
            bytes(message.data),
            self._clock(),
            message.is_remote_frame,
            message.is_extended_id and not message.is_error_frame,
            message.is_error_frame,
        )

    def write(self, frame: Frame) -> bool:
        """See `Link.write`."""
        message = can.Message(
            arbitration_id=frame.cob_id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            data=None if frame.remote else frame.data,
        )
        try:
            self._bus.send(message, timeout=0)
        except Exception as error:
            if self._is_full(error):
                return False
            raise Lost(_reason(error)) from error
        return True

    def _is_full(self, error: Exception) -> bool:
        """Whether a failed send means no more than that there is no room now."""
        return isinstance(error, can.CanTimeoutError) or _code(error) in _FULL

    async def close(self) -> None:
        """Close the interface; within `SHUTDOWN`, or without us."""
        with contextlib.suppress(Exception):
            async with asyncio.timeout(SHUTDOWN):
                await in_thread(self._shut_down, abandon=lambda _: None)

    def _shut_down(self) -> None:
        with self._reading:  # a driver need not bear being closed while a thread reads
            self._closed = True
            self._bus.shutdown()


_FRAME = struct.Struct("=IB3x8s")
"""Linux's `struct can_frame`: identifier and flags, length, data."""
_UNPACK, _SIZE = _FRAME.unpack, _FRAME.size
_LARGEST = 72
"""Bytes of the other that can come, `struct canfd_frame`."""
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_STANDARD = 0x7FF


def _uncommon(flags: int, data: bytes, now: float) -> Frame:
    """What no CANopen node sends: extended and remote frames, and the controller's error frames."""
    error = bool(flags & _ERROR)
    remote = bool(flags & _REMOTE)
    extended = bool(flags & _EXTENDED) and not error
    cob_id = flags & (0x1FFF_FFFF if extended or error else _STANDARD)
    return Frame(cob_id, b"" if remote else data, now, remote, extended, error)


class _SocketcanLink(_Link):
    """Linux SocketCAN. Reads and writes the kernel's frames itself, in a third of the time that `can.Message`
    takes.
    """

    shows_all = True
    _SO_RCVBUFFORCE, _SO_MEMINFO = 33, 55  # asm-generic/socket.h; Python names neither

    def __init__(self, bus: can.BusABC, channel: str, raw: socket.socket) -> None:
        super().__init__(bus, "socketcan")
        self._channel = channel
        self._socket = raw
        raw.setblocking(False)
        for option in (
            self._SO_RCVBUFFORCE,
            socket.SO_RCVBUF,
        ):  # the first takes root, the second has a limit
            with contextlib.suppress(OSError):
                raw.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BUFFER)
                break

    @property
    def is_off(self) -> bool:
        """See `Link.is_off`."""
        return not has_carrier(self._channel)

    @property
    def overrun(self) -> int:
        """See `Link.overrun`: the kernel's own count for this socket (Linux 4.12 and later)."""
        try:
            memory = self._socket.getsockopt(socket.SOL_SOCKET, self._SO_MEMINFO, 36)
        except OSError:
            return 0
        return int.from_bytes(memory[32:36], sys.byteorder)

    def check(self) -> None:
        """Raise `Lost` if the link is down: binding to it succeeds all the same."""
        if code := self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            raise Lost(_why(code))

    def drain(self, into: list[Frame], limit: int) -> None:
        """See `Source.drain`. One time stamp for all: they waited in the kernel until now."""
        receive, now = self._socket.recv, self._clock()
        try:
            for _ in range(limit):
                raw = receive(_LARGEST)
                if len(raw) != _SIZE:
                    if not raw:
                        raise Lost("the socket was closed")
                    continue  # CAN FD
                flags, length, data = _UNPACK(raw)
                if flags <= _STANDARD:
                    into.append(Frame(flags, data[:length], now))
                else:
                    into.append(_uncommon(flags, data[:length], now))
        except BlockingIOError:
            return
        except OSError as error:
            raise Lost(_reason(error)) from error

    def write(self, frame: Frame) -> bool:
        """See `Link.write`."""
        flags = frame.cob_id | (_EXTENDED if frame.extended else 0)
        if frame.remote:
            raw = _FRAME.pack(flags | _REMOTE, 0, b"")
        else:
            raw = _FRAME.pack(flags, len(frame.data), frame.data)
        try:
            self._socket.send(raw)
        except OSError as error:
            if error.errno in _FULL:
                return False
            raise Lost(_reason(error)) from error
        return True


class _SocketcandLink(_Link):
    """A socketcand server over TCP.

    python-can reads on for ever, without an error, after the server closed the connection, and its `send`
    blocks while the server reads nothing; so look first in both directions.
    """

    def __init__(self, bus: can.BusABC, tcp: socket.socket) -> None:
        super().__init__(bus, "socketcand")
        self._socket = tcp

    def descriptor(self) -> int | None:
        """The connection's."""
        return self._socket.fileno()

    def drain(self, into: list[Frame], limit: int) -> None:
        """See `Source.drain`."""
        super().drain(into, limit)
        if len(into) < limit:
            self._look_for_end()

    def _look_for_end(self) -> None:
        try:
            ended = not self._socket.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError as error:
            raise Lost(_reason(error)) from error
        if ended:
            raise Lost("the socketcand server closed the connection")

    def write(self, frame: Frame) -> bool:
        """See `_Link.write`. A writable TCP socket has room for thousands of bytes, and a frame takes 50."""
        try:
            writable = select.select((), (self._socket,), (), 0)[1]
        except (OSError, ValueError) as error:
            raise Lost(_reason(error)) from error
        return bool(writable) and super().write(frame)


def _link(bus: can.BusABC, interface: str, channel: str | None) -> _Link:
    """The link that knows most about its interface.

    python-can 4.6 gives its socketcand interface no ``fileno()`` and keeps the socket private: this is the
    one place that knows its name. Should a release rename it, a reader thread does the work, without noticing
    the end of the connection before it sends.
    """
    raw = getattr(bus, "socket", None)
    if interface == "socketcan" and channel and isinstance(raw, socket.socket):
        return _SocketcanLink(bus, channel, raw)
    tcp = getattr(bus, "_SocketCanDaemonBus__socket", None)
    if interface == "socketcand" and isinstance(tcp, socket.socket) and hasattr(socket, "MSG_DONTWAIT"):
        return _SocketcandLink(bus, tcp)
    return _Link(bus, interface)


def _code(error: Exception) -> int | None:
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return code if isinstance(code, int) and code > 0 else None


def _reason(error: Exception) -> str:
    code = _code(error)
    return str(error).split("\n", 1)[0] if code is None else _why(code)


def _why(code: int) -> str:
    words = {
        errno.ENETDOWN: "the link is down",
        errno.ENXIO: "the adapter is gone",
        errno.ENODEV: "the adapter is gone",
        errno.ECONNRESET: "the server broke the connection",
        errno.EPIPE: "the server closed the connection",
    }
    return f"{words.get(code, os.strerror(code))} (errno {code})"
