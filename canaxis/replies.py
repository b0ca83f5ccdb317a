"""What the service answers, as frozen dataclasses; the fields are the contract's (openapi/openapi.json)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from canaxis.errors import Obstacle

ENDED = frozenset({"succeeded", "failed", "cancelled"})
"""States that an operation doesn't leave any more."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A length or a speed: in microsteps (per second), and in the axis's unit."""

    steps: int
    value: float
    unit: str


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


@dataclass(frozen=True, slots=True)
class LeaseGranted:
    """A lease that was just taken, with the token of its holder."""

    id: str
    token: str
    fencing: int
    """Higher than that of every lease before."""
    owner: str


@dataclass(frozen=True, slots=True)
class Lease:
    """A lease as everybody may see it."""

    id: str
    owner: str
    expires_in_s: float


@dataclass(frozen=True, slots=True)
class OperationAxis:
    """An axis that takes part in an operation."""

    node: int
    axis: int
    name: str


@dataclass(frozen=True, slots=True)
class AxisTrack:
    """Where an axis was, was sent and is; None where it is not known."""

    node: int
    axis: int
    start: Quantity | None
    target: Quantity | None
    end: Quantity | None


@dataclass(frozen=True, slots=True)
class Sight:
    """A statusword that differed from the one before."""

    node: int
    axis: int
    after_s: float
    """Seconds since the operation was begun."""
    statusword: str
    position: Quantity | None


@dataclass(frozen=True, slots=True)
class SeenEmergency:
    """An emergency that came while the operation ran."""

    node: int
    axis: int | None
    time: datetime
    code: str
    title: str


@dataclass(frozen=True, slots=True)
class FoundAxis:
    """An axis as it was found after the service had started again."""

    node: int
    axis: int
    time: datetime
    state: str | None
    moving: bool
    position: Quantity | None
    velocity: Quantity | None


@dataclass(frozen=True, slots=True)
class Evidence:
    """What was seen of the axes while the operation ran."""

    axes: tuple[AxisTrack, ...]
    statuswords: tuple[Sight, ...]
    left_out: int
    emergencies: tuple[SeenEmergency, ...]
    found: tuple[FoundAxis, ...] = ()


@dataclass(frozen=True, slots=True)
class Asker:
    """Who asked for an operation."""

    name: str
    address: str


@dataclass(frozen=True, slots=True)
class OperationStatus:
    """A command that takes time: what was asked, how far it is, how it ended."""

    id: str
    kind: str
    axes: tuple[OperationAxis, ...]
    state: str
    """queued, running, succeeded, failed or cancelled."""
    progress: float | None
    """0 to 1, where it can be told."""
    request: Mapping[str, Any]
    result: Mapping[str, Any] | None
    error: Mapping[str, Any] | None
    """The problem why it failed."""
    reason: str | None
    asked_by: Asker
    evidence: Evidence
    created: datetime
    started: datetime | None
    ended: datetime | None
    predicted_s: float | None = None
    """Seconds that it should take, without what it waits for; None while that isn't known."""
    predicted_peak_velocity: Quantity | None = None

    @property
    def done(self) -> bool:
        """Whether it ended, in whatever way."""
        return self.state in ENDED


@dataclass(frozen=True, slots=True)
class OperationStatuses:
    """Operations, the newest first."""

    operations: tuple[OperationStatus, ...]


@dataclass(frozen=True, slots=True)
class PathLimits:
    """A way against the limits of its axis."""

    lowest: Quantity
    highest: Quantity
    limit_low: Quantity
    limit_high: Quantity
    within: bool


@dataclass(frozen=True, slots=True)
class Write:
    """A parameter that would be written; `old` is None where it isn't known."""

    index: str
    sub: int
    name: str
    old: int | None
    new: int
    unit: str


@dataclass(frozen=True, slots=True)
class AxisSettings:
    """What an axis is set to."""

    node: int
    axis: int
    name: str
    unit: str
    """What positions are shown in."""
    units: tuple[str, ...]
    """What commands may be given in."""
    revision: int | None
    durable: bool
    """Whether changes outlive the service."""
    problem: str | None
    settings: Mapping[str, Any]
    """As `Axis.configure` takes them: numbers as ``{"value": 20, "unit": "mm/s"}``."""
    sources: Mapping[str, str]
    """Where each comes from: revision, file, default or module."""
    written: tuple[Write, ...]
    """What was written to the module by the change that this answers."""
    etag: str
    """Names this state of them."""


@dataclass(frozen=True, slots=True)
class Preview:
    """What a command would come to; nothing was sent."""

    kind: str
    accepted: bool
    """Whether it would be taken now."""
    begins: str | None
    """at_once, take_over, replace or queue; None where it would be refused."""
    obstacles: tuple[Obstacle, ...]
    request: Mapping[str, Any]
    predicted_s: float | None
    """Seconds, without what it waits for; of a homing the longest. None: not known."""
    predicted_peak_velocity: Quantity | None
    start: Quantity | None
    end: Quantity | None
    path: PathLimits | None
    assumed: tuple[str, ...]
    writes: tuple[Write, ...]


@dataclass(frozen=True, slots=True)
class PredictedAxis:
    """What one axis of a coordinated move would be told; None where it has no way to go."""

    node: int
    axis: int
    name: str
    start: Quantity
    target: Quantity
    velocity: Quantity | None
    acceleration: Quantity | None
    deceleration: Quantity | None
    predicted_s: float | None
    path: PathLimits
    writes: tuple[Write, ...]
    obstacles: tuple[Obstacle, ...]


@dataclass(frozen=True, slots=True)
class MovesPrediction:
    """What a coordinated move would come to; nothing was sent."""

    ready: bool
    """Whether it would be accepted now."""
    predicted_s: float
    spread_s: float
    """Seconds between the first arrival and the last."""
    axes: tuple[PredictedAxis, ...]


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


@dataclass(frozen=True, slots=True)
class DigitalInput:
    """A digital input."""

    number: int
    name: str
    on: bool


@dataclass(frozen=True, slots=True)
class AnalogInput:
    """An analog input."""

    number: int
    name: str
    raw: int
    """As the converter has it."""
    volts: float | None
    """None unless the service's settings say what the highest value stands for."""


@dataclass(frozen=True, slots=True)
class Switch:
    """A limit or home switch of an axis; on: pressed."""

    axis: int
    name: str
    on: bool
    age_s: float | None
    stale: bool


@dataclass(frozen=True, slots=True)
class Inputs:
    """All inputs of a node."""

    digital: tuple[DigitalInput, ...]
    analog: tuple[AnalogInput, ...]
    switches: tuple[Switch, ...]
    age_s: float
    """Seconds since the digital and analog inputs were asked for, when the service answered."""


@dataclass(frozen=True, slots=True)
class Output:
    """A digital output as the module holds it."""

    number: int
    name: str
    on: bool
    usable: bool
    """Whether the pin is an output, so that it can be switched."""
    push_pull: bool


@dataclass(frozen=True, slots=True)
class Outputs:
    """All outputs of a node."""

    outputs: tuple[Output, ...]


@dataclass(frozen=True, slots=True)
class NamedPosition:
    """A position that was given a name."""

    name: str
    position: Quantity
    unreferenced: bool
    """Whether the axis goes there though it was not homed."""
    within_limits: bool
    taught: datetime
    taught_by: str


@dataclass(frozen=True, slots=True)
class NamedPositions:
    """The named positions of an axis."""

    positions: tuple[NamedPosition, ...]


@dataclass(frozen=True, slots=True)
class StopState:
    """Whether motion is refused because everything was stopped."""

    latched: bool
    reason: str | None
    time: datetime | None


@dataclass(frozen=True, slots=True)
class AxisStop:
    """What became of one axis when everything was stopped."""

    node: int
    axis: int
    outcome: str
    """stopped, unreachable or failed"""
    message: str


@dataclass(frozen=True, slots=True)
class StopReport:
    """What a stop for everything found."""

    reason: str | None
    complete: bool
    """Whether every axis was seen to stand."""
    axes: tuple[AxisStop, ...]


@dataclass(frozen=True, slots=True)
class BusStatus:
    """The wire, and what passed over it."""

    name: str
    state: str
    reason: str
    warnings: tuple[str, ...]
    counters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Ready:
    """Whether everything that is configured can be commanded, and what is missing."""

    ready: bool
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
