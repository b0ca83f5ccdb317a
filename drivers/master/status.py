"""Snapshots of an axis, a node and the bus: frozen, each with one writer."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from datetime import datetime

from drivers.bus.base import BusState
from drivers.cia301.nmt import NmtState
from drivers.cia402.modes import Mode
from drivers.cia402.power import PowerState
from drivers.master.counters import NetworkCounters, NodeCounters
from drivers.master.emergencies import EmergencyRecord


@dataclass(frozen=True, slots=True)
class Switches:
    """The switches of an axis as 60FDh shows them (bits 0, 1 and 2 of CiA 402; unverified on hardware)."""

    negative_limit: bool = False
    positive_limit: bool = False
    home: bool = False


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """What an axis's TPDOs said last. `updated` and `stale` tell how far to trust it."""

    state: PowerState | None = None
    """None until the first statusword, or where the statusword names no state."""
    mode: Mode = Mode.NO_MODE
    """6061h"""
    statusword: int = 0
    """6041h"""
    position: int | None = None
    """6064h, steps"""
    velocity: int | None = None
    """606Ch, steps/s"""
    target_reached: bool = False
    """Statusword bit 10."""
    moving: bool = False
    """Statusword bit 14."""
    referenced: bool = False
    """Whether a homing was attained since the module's last reset."""
    switches: Switches = field(default_factory=Switches)
    emergencies: tuple[EmergencyRecord, ...] = ()
    """The active ones of this axis and of the whole module."""
    updated: float = -math.inf
    """Loop time at which the older of the two status TPDOs came; -inf: never."""
    stale: bool = True
    """Whether a status TPDO is overdue, so that all the rest may be wrong."""


class NodeState(enum.StrEnum):
    """How far a node is on its way to being used."""

    ABSENT = "absent"
    """Never answered."""
    BOOTED = "booted"
    """Answered or booted; not yet known."""
    IDENTIFIED = "identified"
    """Is what the configuration says; being configured."""
    CONFIGURED = "configured"
    """Holds what it must, read back; being started."""
    OPERATIONAL = "operational"
    """NMT Operational; its axes may be commanded."""
    LOST = "lost"
    """Was there; silent now. Whether its motors turn is unknown."""
    REFUSED = "refused"
    """Is something else, or doesn't hold what it must; nothing is written to it."""
    DUPLICATE = "duplicate"
    """Two nodes answer under this ID; motion is blocked."""


class Failsafe(enum.StrEnum):
    """Whether the module stops its motors when our heartbeat ends."""

    VERIFIED = "verified"
    """Seen to happen on this module since its last boot-up."""
    UNVERIFIED = "unverified"
    """1029h:1 reads as it should, and 1016h too; whether the firmware follows was not tried."""
    OFF = "off"
    """The module would not take 1029h:1."""


@dataclass(frozen=True, slots=True)
class Identity:
    """1000h and 1018h."""

    device_type: int
    vendor_id: int
    product_code: int
    revision: int | None = None
    serial: int | None = None


@dataclass(frozen=True, slots=True)
class NodeStatus:
    """One node at one moment."""

    state: NodeState
    reason: str
    """Why it is in this state, as a sentence; empty when all is well."""
    nmt_state: NmtState | None
    """As its last heartbeat said; None: never heard, or lost."""
    identity: Identity | None
    device_name: str
    hardware_version: str
    software_version: str
    serial: int | None
    failsafe: Failsafe
    heartbeat_age_s: float | None
    """Seconds since its last heartbeat; None: never heard."""
    emergencies: tuple[EmergencyRecord, ...]
    """The active ones, of all axes and the module."""
    counters: NodeCounters


@dataclass(frozen=True, slots=True)
class BusStatus:
    """The wire at one moment."""

    name: str
    state: BusState
    reason: str
    """Why it is in this state; empty when all is well."""
    warnings: tuple[str, ...]
    """Sentences on what is odd on the bus, e.g. a node under a borrowed ID."""
    counters: NetworkCounters


@dataclass(frozen=True, slots=True)
class StopLatch:
    """A stop for everything that was given and not yet reset."""

    reason: str
    time: datetime


class StopOutcome(enum.StrEnum):
    """What became of one axis in a stop for everything."""

    STOPPED = "stopped"
    """Seen to stand."""
    UNREACHABLE = "unreachable"
    """Its node is away: whether it moves is unknown."""
    FAILED = "failed"
    """Did not come to standstill in time."""


@dataclass(frozen=True, slots=True)
class AxisStop:
    """One axis's line in a stop report."""

    node: int
    axis: int
    outcome: StopOutcome
    message: str


@dataclass(frozen=True, slots=True)
class StopReport:
    """What a stop for everything found, axis by axis."""

    latch: StopLatch
    axes: tuple[AxisStop, ...]

    @property
    def complete(self) -> bool:
        """Whether every axis was seen to stand."""
        return all(axis.outcome is StopOutcome.STOPPED for axis in self.axes)
