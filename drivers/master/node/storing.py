"""A module's own memory: "save" and "load" (1010h, 1011h; manual §3.1.7, §3.1.8).

Guarded: what is saved is what the module starts with, whoever drives it then. Only while every axis of the
node is switched off.
"""

from __future__ import annotations

import enum
from typing import Final

from drivers.cia301.objects import Address
from drivers.errors import BadValue, NotReady
from drivers.master.node.body import NodeBody
from drivers.master.node.boot import boot_obstacles
from drivers.master.sdo.client import Priority

_STORE: Final = 0x1010
_RESTORE: Final = 0x1011
_SAVE: Final = int.from_bytes(b"save", "little")
_LOAD: Final = int.from_bytes(b"load", "little")
_FIRST_AXIS: Final = 4


class StoredGroup(enum.StrEnum):
    """Which parameters."""

    ALL = "all"
    """Sub-index 1."""
    COMMUNICATION = "communication"
    """Sub-index 2: bit rate and node ID (2704h, 2705h)."""
    AXIS = "axis"
    """Sub-index 4 and on: those of one axis."""


async def store(node: NodeBody, group: StoredGroup, axis: int | None = None) -> None:
    """Have the module keep what it holds now over a reset; `axis` belongs to `AXIS`.

    Raises `NotReady` while an axis is in use or switched on, `NodeAway`, `BadValue`, `SdoError`: a failed
    store is aborted with 06060000h.
    """
    await _sign(node, _STORE, _SAVE, group, axis)


async def restore_defaults(node: NodeBody, group: StoredGroup, axis: int | None = None) -> None:
    """Have the module start with its defaults after its next reset. Nothing changes before that.

    `COMMUNICATION` has no function (manual §3.1.8). Raises as `store`.
    """
    if group is StoredGroup.COMMUNICATION:
        raise BadValue(
            "The module has no function for restoring communication parameters alone (manual §3.1.8).",
            hint="Restore all, or an axis; bit rate and node ID are set by LSS or 2704h and 2705h.",
            node=node.node_id,
        )
    await _sign(node, _RESTORE, _LOAD, group, axis)


async def _sign(node: NodeBody, index: int, signature: int, group: StoredGroup, axis: int | None) -> None:
    if (group is StoredGroup.AXIS) != (axis is not None):
        raise BadValue("An axis is named with the group axis, and only then.", node=node.node_id)
    node.require_operational()
    if found := tuple(boot_obstacles(node)):
        reasons = " ".join(obstacle.message for obstacle in found)
        raise NotReady(
            f"The memory of node {node.name} is only touched while all its axes are switched off: {reasons}",
            obstacles=found,
            node=node.node_id,
        )
    sub = {StoredGroup.ALL: 1, StoredGroup.COMMUNICATION: 2}.get(group, _FIRST_AXIS + (axis or 0))
    await node.objects.write(Address(index, sub), signature, priority=Priority.CONFIGURE)
