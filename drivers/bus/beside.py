"""The same wire opened by another process, for one that only sends: blocking, lean, and quick to start.

Nothing of asyncio or python-can is imported here: a process that is to be punctual starts in a moment and
holds little. What others send is not handed over.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence
from typing import Protocol

from drivers.bus.base import Beside
from drivers.bus.frame import Frame
from drivers.errors import BusDown, BusOverflow

OPENING = 5.0
"""Seconds that the other side may take for each answer while the wire is opened."""
SENDING = 0.05
"""Seconds that a server may take to take a frame; then the wire counts as gone."""
_SOL_CAN_RAW, _CAN_RAW_FILTER = 101, 1  # linux/can/raw.h; Python names them only where the kernel has them
_CAN_FRAME = struct.Struct("=IB3x8s")


class Door(Protocol):
    """The open wire."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Put frames on the wire, in order. Raises `BusDown`, `BusOverflow`."""
        ...

    def drain(self) -> None:
        """Forget what came meanwhile, so that it holds nobody up. Raises `BusDown` if the wire is gone."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


def open_beside(way: Beside) -> Door:
    """Open the wire. Raises `BusDown`."""
    try:
        return _Socketcand(way) if way.interface == "socketcand" else _Socketcan(way)
    except OSError as error:
        raise BusDown(
            f"{way.interface}:{way.channel} can't be opened a second time: {error.strerror or error}"
        ) from error


class _Socketcan:
    """Linux SocketCAN: a raw socket that receives nothing."""

    def __init__(self, way: Beside) -> None:
        family: int = getattr(socket, "AF_CAN", 29)
        raw = socket.socket(family, socket.SOCK_RAW, getattr(socket, "CAN_RAW", 1))
        try:
            raw.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FILTER, b"")
            raw.bind((way.channel,))
            raw.setblocking(False)
        except OSError:
            raw.close()
            raise
        self._socket = raw

    def send(self, frames: Sequence[Frame]) -> None:
        """See `Door.send`."""
        try:
            for frame in frames:
                self._socket.send(_CAN_FRAME.pack(frame.cob_id, len(frame.data), frame.data))
        except BlockingIOError:
            raise BusOverflow("the interface takes no more frames") from None
        except OSError as error:
            raise BusDown(f"the interface is gone: {error.strerror or error}") from error

    def drain(self) -> None:
        """See `Door.drain`: the filter lets nothing through."""

    def close(self) -> None:
        """See `Door.close`."""
        self._socket.close()


class _Socketcand:
    """A client of a socketcand server, in raw mode. What it says is not even parsed."""

    def __init__(self, way: Beside) -> None:
        self._socket = socket.create_connection((way.host, way.port), OPENING)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._expect(b"< hi >")
            self._socket.sendall(f"< open {way.channel} >".encode("ascii"))
            self._expect(b"< ok >")
            self._socket.sendall(b"< rawmode >")
            self._expect(b"< ok >")
            # Python's own time limit would have every call wait, the ones that must not wait too.
            self._socket.settimeout(None)
            seconds, fraction = divmod(SENDING, 1.0)
            limit = struct.pack("@ll", int(seconds), int(fraction * 1e6))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        except (OSError, BusDown):
            self._socket.close()
            raise

    def _expect(self, answer: bytes) -> None:
        said = b""
        while answer not in said:
            piece = self._socket.recv(4096)
            said += piece
            if not piece or len(said) > 65_536 or b"< error" in said:
                raise BusDown(f"the socketcand server answered {said[:80]!r} instead of {answer!r}")

    def send(self, frames: Sequence[Frame]) -> None:
        """See `Door.send`."""
        text = "".join(
            f"< send {frame.cob_id:03X} {len(frame.data):X} {frame.data.hex(' ')} >" for frame in frames
        )
        try:
            self._socket.sendall(text.encode("ascii"))
        except OSError as error:
            raise BusDown(f"the socketcand server is gone: {error.strerror or error}") from error

    def drain(self) -> None:
        """See `Door.drain`."""
        while True:
            try:
                piece = self._socket.recv(65_536, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError as error:
                raise BusDown(f"the socketcand server is gone: {error.strerror or error}") from error
            if not piece:
                raise BusDown("the socketcand server closed the connection")

    def close(self) -> None:
        """See `Door.close`."""
        self._socket.close()
