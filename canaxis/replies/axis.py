"""An axis: what it does, and what prevents its commands."""

from __future__ import annotations

from dataclasses import dataclass

from canaxis.obstacles import Obstacle
from canaxis.replies.quantity import Quantity


@dataclass(frozen=True, slots=True)
class Limits:
    """The limit switches; True: pressed."""

    negative: bool
    positive: bool


@dataclass(frozen=True, slots=True)
class ActiveEmergency:
    """An emergency that is still active."""

    id: int
    code: str
    title: str
    cause: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Found:
    """How an axis was found that nobody has enabled since the service started."""

    reason: str
    state: str | None
    mode: str
    moving: bool
    position: Quantity | None
    velocity: Quantity | None


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """What an axis does, from the last process data that its module sent."""

    node: int
    axis: int
    name: str
    state: str | None
    """CiA 402's state, such as `operation_enabled`; None while nothing is known."""
    mode: str
    statusword: str
    position: Quantity | None
    velocity: Quantity | None
    target_reached: bool
    moving: bool
    referenced: bool
    reference: str
    adopted: bool
    found: Found | None
    limits: Limits
    home_switch: bool
    emergencies: tuple[ActiveEmergency, ...]
    operation: str | None
    """ID of the operation that holds the axis."""
    age_s: float | None
    stale: bool
    """Whether this is too old to rely on."""
    queued: tuple[str, ...] = ()
    """IDs of the operations that wait for the axis, the next first."""


@dataclass(frozen=True, slots=True)
class AxisStatuses:
    """All axes of a node."""

    axes: tuple[AxisStatus, ...]


@dataclass(frozen=True, slots=True)
class Readiness:
    """What prevents each command now, each obstacle with its remedy, in the order of what to do first."""

    ready: bool
    """Whether a move would be accepted now."""
    enable: tuple[Obstacle, ...]
    move: tuple[Obstacle, ...]
    velocity: tuple[Obstacle, ...]
    home: tuple[Obstacle, ...]
    disable: tuple[Obstacle, ...] = ()
    reset_fault: tuple[Obstacle, ...] = ()
    set_position: tuple[Obstacle, ...] = ()
    jog: tuple[Obstacle, ...] = ()
