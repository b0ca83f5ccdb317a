"""Axes on the wire: status, readiness, and the bodies of the moving commands."""

from __future__ import annotations

from pydantic import Field

from app.http import examples
from app.http.schemas import Number, ObstacleReply, OnBusyChoice, Quantity, Rate, Reply, Request, Unit


class MoveBody(Request):
    """Go to a position, or by a distance. What is left out comes from the axis's settings."""

    model_config = examples.shown(examples.MOVE)

    target: Number = Field(description="Position or distance in `unit`; whole where the unit is steps.")
    unit: Unit
    relative: bool = Field(default=False, description="Whether `target` is a distance from here.")
    velocity: Rate = Field(default=None, description="`unit`/s")
    acceleration: Rate = Field(default=None, description="`unit`/s2")
    deceleration: Rate = Field(default=None, description="`unit`/s2")
    on_busy: OnBusyChoice = "reject"


class VelocityBody(Request):
    """Run at a speed, until something else is commanded or to at most one of three ends; 0 stops."""

    model_config = examples.shown(examples.VELOCITY)

    velocity: Number = Field(description="`unit`/s; the sign is the direction.")
    unit: Unit
    acceleration: Rate = Field(default=None, description="`unit`/s2, up and down.")
    duration_s: float | None = Field(
        default=None, gt=0, le=86_400, description="It turns that long at its speed, then ramps down."
    )
    travel: Rate = Field(
        default=None,
        description="Distance in `unit` from standstill to standstill; the module ends it, to the step.",
    )
    lease: bool = Field(
        default=False, description="It ends with the lease that it is sent under (header Lease), by a stop."
    )
    on_busy: OnBusyChoice = "reject"


class HomeBody(Request):
    """Seek the reference. What is left out comes from the axis's settings."""

    model_config = examples.shown(examples.HOME)

    method: int | None = Field(default=None, ge=-128, le=127, description="Homing method (6098h).")
    unit: Unit | None = Field(default=None, description="Needed with any speed or acceleration.")
    fast: Rate = Field(default=None, description="Speed while seeking the switch, `unit`/s")
    slow: Rate = Field(default=None, description="Speed while seeking the edge, `unit`/s")
    acceleration: Rate = Field(default=None, description="`unit`/s2")
    timeout_s: float | None = Field(
        default=None,
        gt=0,
        le=3600,
        description="Seconds it may take; left out, it follows from the way and the speeds.",
    )
    on_busy: OnBusyChoice = "reject"


class SetPositionBody(Request):
    """Where the axis stands. Nothing moves."""

    model_config = examples.shown(examples.SET_POSITION)

    position: Number = Field(description="In `unit`; whole where the unit is steps.")
    unit: Unit
    shift_limits: bool = Field(
        default=False,
        description="Needed where the axis was homed and has travel limits: they are counted in its "
        "positions, so another position for the same place moves them.",
    )


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


class AxisStatusReply(Reply):
    """What an axis does now, from the last process data that its module sent."""

    model_config = examples.shown(examples.AXIS)

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

    model_config = examples.shown({"axes": [examples.AXIS]})

    axes: list[AxisStatusReply]


class ReadinessReply(Reply):
    """What prevents each command now, in the order of what to do first."""

    model_config = examples.shown(examples.READINESS)

    ready: bool = Field(description="Whether a move would be accepted now.")
    enable: list[ObstacleReply]
    disable: list[ObstacleReply]
    reset_fault: list[ObstacleReply]
    move: list[ObstacleReply]
    velocity: list[ObstacleReply]
    home: list[ObstacleReply]
    set_position: list[ObstacleReply]
    jog: list[ObstacleReply]
