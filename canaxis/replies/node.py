"""A module: what it is, its emergencies, its objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any


@dataclass(frozen=True, slots=True)
class Identity:
    """What the module says it is (1000h, 1018h)."""

    device_type: str
    vendor_id: str
    product_code: str
    revision: int | None
    serial: int | None


@dataclass(frozen=True, slots=True)
class AxisName:
    """An axis of a node, by number and name."""

    axis: int
    name: str
    unit: str


@dataclass(frozen=True, slots=True)
class NodeStatus:
    """One module. `boot` has every step of its last boot-up, `counters` what passed between us."""

    node: int
    name: str
    model: str
    state: str
    reason: str
    """Why it is in this state; empty when all is well."""
    nmt_state: str | None
    identity: Identity | None
    device_name: str
    hardware_version: str
    software_version: str
    serial: int | None
    failsafe: str
    heartbeat_age_s: float | None
    axes: tuple[AxisName, ...]
    boot: Mapping[str, Any]
    counters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class NodeStatuses:
    """All configured nodes."""

    nodes: tuple[NodeStatus, ...]


@dataclass(frozen=True, slots=True)
class Emergency:
    """One emergency that a node reported, with its meaning."""

    id: int
    time: datetime
    node: int
    axis: int | None
    code: str
    register: str
    data: str
    title: str
    cause: str
    remedy: str
    severity: str
    active: bool


@dataclass(frozen=True, slots=True)
class Emergencies:
    """A node's emergencies, the newest first."""

    emergencies: tuple[Emergency, ...]


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a set bit, or the value, of an object says."""

    name: str
    title: str
    cause: str
    remedy: str


@dataclass(frozen=True, slots=True)
class ObjectValue:
    """The value of one object; bytes are shown in hexadecimal."""

    node: int
    index: str
    sub: int
    name: str
    type: str
    access: str
    unit: str
    value: Any
    """A number, a text, or a truth value."""
    meanings: tuple[Meaning, ...]
