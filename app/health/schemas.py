"""The bus, the stop for everything, and the service itself, on the wire."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from app.http import examples
from app.http.schemas import Reply, Request


class BusReply(Reply):
    """The wire, and what passed over it."""

    model_config = examples.shown(examples.BUS)

    name: str
    state: str = Field(description="closed, active, warning, passive, bus_off, down")
    reason: str = Field(description="Why it is in this state; empty when all is well.")
    warnings: list[str]
    counters: dict[str, int]


class StopBody(Request):
    """A stop for everything."""

    model_config = examples.shown(examples.STOP)

    reason: str = Field(default="Stopped over HTTP.", min_length=1, max_length=200)


class StopState(Reply):
    """Whether a stop is latched."""

    model_config = examples.shown(examples.STOP_STATE)

    latched: bool
    reason: str | None
    time: datetime | None


class AxisStopReply(Reply):
    """What became of one axis."""

    node: int
    axis: int
    outcome: str = Field(description="stopped, unreachable or failed")
    message: str


class StopReply(Reply):
    """What the stop found, axis by axis."""

    model_config = examples.shown(examples.STOP_REPORT)

    latched: bool
    reason: str | None
    time: datetime | None
    complete: bool = Field(description="Whether every axis was seen to stand.")
    axes: list[AxisStopReply]


class LiveReply(Reply):
    """The process answers."""

    model_config = examples.shown(examples.LIVE)

    status: str = Field(examples=["alive"])


class ReadyReply(Reply):
    """Whether everything that is configured can be commanded, and what is missing."""

    model_config = examples.shown(examples.READY)

    ready: bool
    reasons: list[str]
    warnings: list[str] = Field(description="What does not prevent commands, but should be put right.")


class TicketReply(Reply):
    """What opens one stream, once."""

    model_config = examples.shown(examples.TICKET)

    ticket: str = Field(description="For the query parameter `ticket` of a stream.")
    role: str = Field(description="read, stop, move or configure: that of the token it was asked with.")
    expires_in_s: float


class ServiceReply(Reply):
    """Where everything is."""

    model_config = examples.shown(examples.SERVICE)

    name: str
    version: str
    links: dict[str, str]


class ProblemTypeReply(Reply):
    """The description of one kind of problem."""

    model_config = examples.shown(examples.PROBLEM_TYPE)

    type: str
    code: str
    status: int
    title: str
    explanation: str
