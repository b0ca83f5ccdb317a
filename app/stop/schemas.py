"""The stop for everything on the wire."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from app.http import examples
from app.http.schemas import Reply, Request


class StopBody(Request):
    """A stop for everything."""

    model_config = examples.shown({"reason": "A hand is in the way."})

    reason: str = Field(default="Stopped over HTTP.", min_length=1, max_length=200)


_STATE: examples.Example = {"latched": True, "reason": "A hand is in the way.", "time": examples.TIME}


class StopState(Reply):
    """Whether a stop is latched."""

    model_config = examples.shown(_STATE)

    latched: bool
    reason: str | None
    time: datetime | None


class AxisStopReply(Reply):
    """What became of one axis."""

    node: int
    axis: int
    outcome: str = Field(description="stopped, unreachable or failed")
    message: str


_REPORT: examples.Example = {
    **_STATE,
    "complete": True,
    "axes": [{"node": 1, "axis": 0, "outcome": "stopped", "message": "Axis x stands."}],
}


class StopReply(Reply):
    """What the stop found, axis by axis."""

    model_config = examples.shown(_REPORT)

    latched: bool
    reason: str | None
    time: datetime | None
    complete: bool = Field(description="Whether every axis was seen to stand.")
    axes: list[AxisStopReply]
