"""Network management: the states of a node and the commands that change them (CiA 301 7.2.8)."""

from __future__ import annotations

import enum


class NmtState(enum.IntEnum):
    """What a heartbeat says of its node. BOOT_UP is said once, on entering Pre-operational."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class NmtCommand(enum.IntEnum):
    """What a master can tell nodes."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


ALL_NODES = 0
"""The node-ID of a command that every node obeys."""


def encode(command: NmtCommand, node: int = ALL_NODES) -> bytes:
    """The two bytes of COB-ID 000h. `node` is 0 (all) or 1..127; ValueError otherwise."""
    if not 0 <= node <= 127:
        raise ValueError(f"node-ID {node} is not in 0..127")
    return bytes((command, node))


def decode(data: bytes) -> tuple[NmtCommand, int] | None:
    """Command and node-ID (0: all), or None for what is no NMT command."""
    if len(data) != 2 or data[1] > 127:
        return None
    try:
        return NmtCommand(data[0]), data[1]
    except ValueError:
        return None
