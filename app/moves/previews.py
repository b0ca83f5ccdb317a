"""What a command would come to: the answer to a dry run."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from app.axes.schemas import ChangeReply, Quantity
from app.http import examples
from app.http.schemas import ObstacleReply, Reply


class PathReply(Reply):
    """The way against the limits. A ramp never goes beyond its target, so the ends of the way are all."""

    lowest: Quantity = Field(description="The lowest position on the way.")
    highest: Quantity
    limit_low: Quantity = Field(description="The lowest position that the axis may be sent to.")
    limit_high: Quantity
    within: bool = Field(description="Whether the whole way lies within the limits.")


_PREVIEW: examples.Example = {
    "dry_run": True,
    "kind": "move",
    "node": 1,
    "axis": 0,
    "name": "x",
    "accepted": False,
    "begins": None,
    "obstacles": [examples.OBSTACLE],
    "request": {"target": 51200, "unit": "steps", "relative": False, "target_steps": 51200},
    "predicted_s": 1.5,
    "predicted_peak_velocity": {"steps": 51200, "value": 51200.0, "unit": "steps/s"},
    "start": {"steps": 0, "value": 0.0, "unit": "steps"},
    "end": {"steps": 51200, "value": 51200.0, "unit": "steps"},
    "path": {
        "lowest": {"steps": 0, "value": 0.0, "unit": "steps"},
        "highest": {"steps": 51200, "value": 51200.0, "unit": "steps"},
        "limit_low": {"steps": -100000, "value": -100000.0, "unit": "steps"},
        "limit_high": {"steps": 100000, "value": 100000.0, "unit": "steps"},
        "within": True,
    },
    "assumed": [],
    "writes": [
        {
            "index": "0x6081",
            "sub": 0,
            "name": "Profile velocity",
            "axis": 0,
            "old": None,
            "new": 51200,
            "unit": "steps/s",
        }
    ],
}


class PreviewReply(Reply):
    """A command that was not given: nothing was sent, no operation was made, no key was spent."""

    model_config = examples.shown(_PREVIEW)

    dry_run: Literal[True]
    kind: str = Field(description="move, velocity or home.")
    node: int
    axis: int
    name: str
    accepted: bool = Field(description="Whether the command would be taken now.")
    begins: str | None = Field(
        description="How: at_once, take_over (from another velocity, without a stop), replace or queue; None "
        "where it would be refused."
    )
    obstacles: list[ObstacleReply] = Field(description="What prevents it, in the order of what to do first.")
    request: dict[str, Any] = Field(description="What was asked, with the steps that it comes to.")
    predicted_s: float | None = Field(
        description="How long it takes, without what it waits for; of a homing the longest. None: not known."
    )
    predicted_peak_velocity: Quantity | None
    start: Quantity | None = Field(description="Where it begins.")
    end: Quantity | None = Field(description="Where it ends, or where it has its speed; of a homing unknown.")
    path: PathReply | None
    assumed: list[str] = Field(description="What the numbers take for granted.")
    writes: list[ChangeReply] = Field(
        description="The parameters that are written before it begins; `old` is None where it isn't known."
    )
