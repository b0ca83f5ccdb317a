"""The messages of a jog: openapi/jog.md is their contract."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from app.axes.schemas import AxisStatusReply, Limits, Quantity, Unit
from app.http.schemas import Number, Problem, Rate, Reply, Request

Milliseconds = Annotated[float, Field(ge=0, le=1e12)]


class HoldMessage(Request):
    """Turn, or go on turning. To be repeated while the axis is held."""

    kind: Literal["hold"]
    seq: int = Field(ge=0, le=2**53, description="Rises with each hold.")
    velocity: Number = Field(description="`unit`/s; the sign is the direction.")
    unit: Unit
    acceleration: Rate = Field(default=None, description="`unit`/s2; counts with the first hold of a press.")
    echo: Milliseconds = Field(description="`stamp` of the newest message that the client has.")
    echo_age_ms: Milliseconds = Field(default=0, description="How long it has had it.")
    sent: Number = Field(default=0, description="The client's clock; comes back in `ack`.")


class ReleaseMessage(Request):
    """Ramp down."""

    kind: Literal["release"]


class LeaseMessage(Request):
    """Hold under this lease from now on; for those who can't send the header `Lease`."""

    kind: Literal["lease"]
    token: str = Field(min_length=1, max_length=255)


class PingMessage(Request):
    """Measure the way."""

    kind: Literal["ping"]
    echo: Milliseconds
    echo_age_ms: Milliseconds = 0
    sent: Number = 0


ClientMessage = HoldMessage | ReleaseMessage | LeaseMessage | PingMessage
CLIENT_MESSAGES: TypeAdapter[ClientMessage] = TypeAdapter(
    Annotated[ClientMessage, Field(discriminator="kind")]
)

JogState = Literal["idle", "starting", "turning", "stopping", "used_up"]


class ServerMessage(Reply):
    """Each has a stamp for the client to echo."""

    stamp: float = Field(description="ms since the connection was accepted.")


class HelloMessage(ServerMessage):
    """The first message."""

    kind: Literal["hello"] = "hello"
    axis: AxisStatusReply
    keep_alive_ms: int = Field(description="How often to hold.")
    silence_ms: int = Field(description="After this long without a hold the axis is stopped.")


class AckMessage(ServerMessage):
    """A hold came: the newest, if several did."""

    kind: Literal["ack"] = "ack"
    seq: int
    sent: Number
    counts: bool = Field(description="Whether it keeps the axis turning; `outcome` says why not.")
    outcome: Literal["begins", "counts", "stale", "used_up", "out_of_order", "refused"]
    round_trip_ms: float | None
    jog: JogState
    position: Quantity | None
    velocity: Quantity | None


class JogStatusMessage(ServerMessage):
    """What the axis does: the latest."""

    kind: Literal["status"] = "status"
    jog: JogState
    state: str | None = Field(description="CiA 402 state.")
    position: Quantity | None
    velocity: Quantity | None
    moving: bool
    limits: Limits
    stale: bool
    operation: str | None


class PongMessage(ServerMessage):
    """The answer to a ping."""

    kind: Literal["pong"] = "pong"
    sent: Number
    round_trip_ms: float | None


class StoppedMessage(ServerMessage):
    """A press has ended, and its operation if it came to one."""

    kind: Literal["stopped"] = "stopped"
    reason: Literal["released", "silence", "lease", "limit", "stop", "fault", "failed", "shutdown"]
    detail: str
    hint: str
    operation: str | None = Field(description="None where it was let go before the axis began.")
    result: dict[str, Any] | None


class ProblemMessage(ServerMessage):
    """A message, or a press, was refused."""

    kind: Literal["problem"] = "problem"
    seq: int | None = Field(description="The hold that it is about.")
    problem: Problem
