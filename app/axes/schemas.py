"""Axes on the wire: quantities with their units, status, readiness."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from app.http import examples
from app.http.schemas import ObstacleReply, Reply

Unit = Annotated[
    str,
    Field(
        min_length=1,
        max_length=16,
        description="`steps` (microsteps), the unit that the axis is configured with, or one that follows "
        "from that or from its gearing: mm and um, deg and turns.",
        examples=["steps"],
    ),
]


class Quantity(Reply):
    """A length or a speed: in steps as the module has it, and in the axis's unit."""

    steps: int = Field(description="Microsteps, or microsteps per second.")
    value: float = Field(description="The same in `unit`.")
    unit: str = Field(examples=["steps"])


class Limits(Reply):
    """The limit switches; True: pressed."""

    negative: bool
    positive: bool


class ActiveEmergency(Reply):
    """An emergency that is still active."""

    id: int
    code: str = Field(description="EMCY error code, hexadecimal.", examples=["0x8130"])
    title: str
    cause: str
    remedy: str


class FoundReply(Reply):
    """How an axis was found that nobody here has enabled; nothing was reset."""

    reason: str = Field(description="Why it must be claimed.")
    state: str | None = Field(description="CiA 402 state (6041h).")
    mode: str = Field(description="CiA 402 mode of operation (6061h).")
    moving: bool
    position: Quantity | None
    velocity: Quantity | None


class AxisLease(Reply):
    """The lease that an axis is in."""

    id: str
    owner: str
    expires_in_s: float = Field(description="Seconds, unless it is renewed.")


_AXIS: examples.Example = {
    "node": 1,
    "axis": 0,
    "name": "x",
    "state": "operation_enabled",
    "mode": "profile_position",
    "statusword": "0x1637",
    "position": {"steps": 51200, "value": 51200.0, "unit": "steps"},
    "velocity": {"steps": 0, "value": 0.0, "unit": "steps/s"},
    "target_reached": True,
    "moving": False,
    "referenced": False,
    "reference": "unknown",
    "adopted": False,
    "found": None,
    "limits": {"negative": False, "positive": False},
    "home_switch": False,
    "emergencies": [],
    "operation": None,
    "queued": [],
    "lease": None,
    "age_s": 0.012,
    "stale": False,
}


class AxisStatusReply(Reply):
    """What an axis does now, from the last process data that its module sent."""

    model_config = examples.shown(_AXIS)

    node: int = Field(description="Node ID.")
    axis: int = Field(description="Axis number.")
    name: str
    state: str | None = Field(description="CiA 402 state, or None while nothing is known.")
    mode: str = Field(description="CiA 402 mode of operation that the drive shows (6061h).")
    statusword: str = Field(description="6041h, hexadecimal.")
    position: Quantity | None
    velocity: Quantity | None
    target_reached: bool
    moving: bool
    referenced: bool = Field(description="Whether the axis was homed since the module started.")
    reference: str = Field(
        description="unknown, homed, or lost (the module started anew by itself, or a homing failed)"
    )
    adopted: bool = Field(
        description="Whether it was found enabled or turning, and nobody has claimed it by enabling it yet."
    )
    found: FoundReply | None = Field(description="How it was found, while it is adopted.")
    limits: Limits
    home_switch: bool
    emergencies: list[ActiveEmergency]
    operation: str | None = Field(description="ID of the operation that holds the axis.")
    queued: list[str] = Field(description="IDs of the operations that wait for it, the next first.")
    lease: AxisLease | None = Field(description="Who has exclusive control of it; None: nobody.")
    age_s: float | None = Field(description="Seconds since the module sent this; None if it never did.")
    stale: bool = Field(description="Whether this is too old to rely on.")


class AxisList(Reply):
    """All axes of a node."""

    model_config = examples.shown({"axes": [_AXIS]})

    axes: list[AxisStatusReply]


_READINESS: examples.Example = {
    "ready": False,
    "enable": [],
    "disable": [],
    "reset_fault": [],
    "move": [examples.OBSTACLE],
    "velocity": [examples.OBSTACLE],
    "home": [examples.OBSTACLE],
    "set_position": [],
    "jog": [examples.OBSTACLE],
}


class ReadinessReply(Reply):
    """What prevents each command now, in the order of what to do first."""

    model_config = examples.shown(_READINESS)

    ready: bool = Field(description="Whether a move would be accepted now.")
    enable: list[ObstacleReply]
    disable: list[ObstacleReply]
    reset_fault: list[ObstacleReply]
    move: list[ObstacleReply]
    velocity: list[ObstacleReply]
    home: list[ObstacleReply]
    set_position: list[ObstacleReply]
    jog: list[ObstacleReply]


class ChangeReply(Reply):
    """An object that held something else than it should, and was written."""

    index: str = Field(description="Object index, hexadecimal.")
    sub: int
    name: str
    axis: int | None = Field(description="None: the object is the node's.")
    old: int | None = Field(description="In `unit`; None if it could not be read.")
    new: int = Field(description="In `unit`; written and read back.")
    unit: str = Field(description="Empty for a plain number.")
