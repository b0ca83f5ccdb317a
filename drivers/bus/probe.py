"""A look at a wire before python-can opens it, so that what is missing is said at once and in plain words."""

from __future__ import annotations

import asyncio
import contextlib
import socket

from drivers.errors import BusDown

GREETING = 1.0
"""Seconds in which a socketcand server must greet."""


async def find_socketcand(host: str, port: int) -> None:
    """Raise `BusDown` unless a socketcand server greets there: python-can would busily try for 10 s."""
    remedy = f"start it with `canaxis simulate`, or correct host and port ({host}:{port})"
    try:
        greeting = await _greeting(host, port)
    except TimeoutError:
        what = f"what listens on {host}:{port} is silent, so it is no socketcand server"
    except OSError:
        what = f"nothing listens on {host}:{port}"
    else:
        if greeting == b"< hi >":
            return
        what = f"what listens on {host}:{port} is no socketcand server"
    raise BusDown(f"{what}; {remedy}", hint=f"{remedy[0].upper()}{remedy[1:]}.")


async def _greeting(host: str, port: int) -> bytes:
    async with asyncio.timeout(GREETING):
        reader, writer = await asyncio.open_connection(host, port)
        try:
            return (await reader.readuntil(b">")).strip()
        except (asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            return b""
        finally:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()


def find_socketcan(channel: str) -> None:
    """Raise `BusDown` if the system has no such interface (python-can would leave a socket open)."""
    try:
        socket.if_nametoindex(channel)
    except OSError:
        raise BusDown(
            f"there is no CAN interface {channel} here",
            hint="Plug the adapter in, or look with `ip link` what it is called.",
        ) from None


def has_carrier(channel: str) -> bool:
    """False if the kernel says that the controller is off the bus; what can't be read counts as well."""
    try:
        with open(f"/sys/class/net/{channel}/carrier", encoding="ascii") as file:
            return file.read().strip() != "0"
    except OSError:
        return True
