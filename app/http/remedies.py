"""Remedies of obstacles as requests that a client can send: the drivers name them, here are their paths."""

from __future__ import annotations

from typing import Any

from app.http.paths import API
from drivers.errors import Obstacle, Remedy

_OF_AXIS = {
    Remedy.STOP: "stop",
    Remedy.DISABLE: "disable",
    Remedy.ENABLE: "enable",
    Remedy.RESET_FAULT: "reset-fault",
    Remedy.HOME: "home",
}
_OF_NODE = {Remedy.BOOT: "boot"}
_OF_ALL = {Remedy.RESET_STOP: "stop/reset"}


def action(remedy: Remedy | None, node: int | None, axis: int | None) -> dict[str, Any] | None:
    """The request that carries a remedy out; None: there is none, or it isn't known for which axis."""
    path: str | None = None
    if remedy is None:
        return None
    if remedy in _OF_ALL:
        path = f"{API}/{_OF_ALL[remedy]}"
    elif remedy in _OF_NODE and node is not None:
        path = f"{API}/nodes/{node}/{_OF_NODE[remedy]}"
    elif remedy in _OF_AXIS and node is not None and axis is not None:
        path = f"{API}/nodes/{node}/axes/{axis}/{_OF_AXIS[remedy]}"
    return None if path is None else {"method": "POST", "path": path, "body": {}}


def obstacle(found: Obstacle, node: int | None, axis: int | None) -> dict[str, Any]:
    """An obstacle as the wire has it."""
    return {
        "code": found.code,
        "message": found.message,
        "remedy": found.remedy,
        "action": action(found.action, node, axis),
    }
