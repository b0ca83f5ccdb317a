"""SocketCAN without a kernel that has it: a pair of local sockets that carries its `can_frame`s.

Each end is a descriptor that gives and takes one 16-byte frame a call, as a raw CAN socket does, so
python-can's `socketcan` runs on it unchanged, and so does everything above. A pair has no bit rate and no
arbitration, and loses nothing by itself: whoever sends keeps the time and counts what the other end refuses.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
from collections.abc import Generator
from contextlib import contextmanager
from unittest import mock

from can.interfaces.socketcan import socketcan

CAN_FRAME = struct.Struct("=IB3x8s")
"""Identifier with its flags, length, data: `struct can_frame` of linux/can.h."""
CHANNEL = "lo"
"""The channel to name: it must be a network interface of this machine that is up."""
FULL_BUS = 9009
"""Frames/s of 8 bytes, without stuff bits, that fill a bus of 1 Mbit/s."""
_ROOM = 2 << 20
"""Bytes that a socket is asked to hold: as many as our link asks of a CAN socket."""
_SO_SNDBUFFORCE = 32


def pair() -> tuple[socket.socket, socket.socket]:
    """Two ends of a wire. Neither blocks when the other's room is full: it raises `BlockingIOError`."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setblocking(False)
        for option in (_SO_SNDBUFFORCE, socket.SO_SNDBUF):  # the first takes root, the second has a limit
            with contextlib.suppress(OSError):
                end.setsockopt(socket.SOL_SOCKET, option, _ROOM)
                break
    return ends


def pack(cob_id: int, data: bytes) -> bytes:
    """A standard data frame as the kernel has it."""
    return CAN_FRAME.pack(cob_id, len(data), data)


@contextmanager
def as_socketcan(end: socket.socket) -> Generator[None]:
    """While entered, python-can's `socketcan` on `CHANNEL` opens `end`, which it then owns."""
    silent = logging.Logger("python-can")  # it complains of options that only a CAN socket has
    silent.disabled = True
    with (
        mock.patch.object(socketcan, "create_socket", return_value=end),
        mock.patch.object(socketcan, "bind_socket"),
        mock.patch.object(socketcan, "log", silent),
    ):
        yield
