"""Coordinated moves on the wire."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from app.axes.schemas import ChangeReply, Quantity
from app.http import examples
from app.http.schemas import ObstacleReply, Reply, Request
from app.moves.schemas import MoveBody, PathReply

Reference = Annotated[int, Field(ge=0, le=127)] | Annotated[str, Field(min_length=1, max_length=64)]


class TargetBody(MoveBody):
    """Where one axis is to go; speeds and accelerations are the most that it may do."""

    node: Reference = Field(description="Node ID or name.")
    axis: Reference = Field(description="Axis number or name.")


_MOVES: examples.Example = {
    "targets": [
        {"node": "stage", "axis": "x", "target": 51200, "unit": "steps"},
        {"node": "stage", "axis": "y", "target": -12800, "unit": "steps", "relative": True},
    ],
    "duration_s": 2.5,
}


class MovesBody(Request):
    """Axes of one bus that are to start and arrive together."""

    model_config = examples.shown(_MOVES)

    targets: list[TargetBody] = Field(min_length=1, max_length=64)
    duration_s: float | None = Field(
        default=None, gt=0, le=86_400, description="Seconds that it is to take at least."
    )
    on_busy: Literal["reject", "replace"] = Field(
        default="reject", description="What becomes of it while an axis is busy: `replace` stops that first."
    )


class PredictedAxis(Reply):
    """What one axis would be told."""

    node: int
    axis: int
    name: str
    start: Quantity
    target: Quantity
    velocity: Quantity | None = Field(description="None where it has no way to go.")
    acceleration: Quantity | None
    deceleration: Quantity | None
    predicted_s: float | None = Field(description="From the start to its standstill.")
    path: PathReply
    writes: list[ChangeReply] = Field(
        description="The parameters that are written before it begins; `old` is None where it isn't known."
    )
    obstacles: list[ObstacleReply] = Field(description="What prevents this axis now.")


class MovesPrediction(Reply):
    """A coordinated move that was not commanded."""

    dry_run: bool
    ready: bool = Field(description="Whether it would be accepted now.")
    predicted_s: float = Field(description="From the start to the standstill of all.")
    spread_s: float = Field(description="Between the first arrival and the last, as predicted.")
    axes: list[PredictedAxis]
