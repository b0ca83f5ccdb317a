"""What prevents a command, and what takes it away."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast


@dataclass(frozen=True, slots=True)
class Action:
    """A request that takes an obstacle away; `Client.follow` sends it."""

    method: str
    path: str
    body: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Obstacle:
    """One thing that prevents a command now, and what to do about it."""

    code: str
    message: str
    remedy: str
    action: Action | None = None
    """What does it; None: it takes waiting, or a person's hands."""


def obstacles_of(problem: Mapping[str, Any]) -> tuple[Obstacle, ...]:
    """The obstacles that a problem object names, in its order, whatever else may be wrong with it."""
    return tuple(
        Obstacle(
            str(row.get("code", "")),
            str(row.get("message", "")),
            str(row.get("remedy", "")),
            _action(row.get("action")),
        )
        for row in rows(problem.get("obstacles"))
    )


def rows(value: object) -> list[Mapping[str, Any]]:
    """The objects in what should be an array of them; what else is there is left out."""
    if not isinstance(value, list):
        return []
    found = cast("list[object]", value)
    return [cast("Mapping[str, Any]", row) for row in found if isinstance(row, Mapping)]


def _action(value: object) -> Action | None:
    if not isinstance(value, Mapping):
        return None
    row = cast("Mapping[str, Any]", value)
    return Action(str(row.get("method", "")), str(row.get("path", "")), row.get("body") or {})
