"""What a command would come to: the answer to a dry run."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from app.http import examples
from app.http.schemas import ObstacleReply, Quantity, Reply
from app.nodes.schemas import ChangeReply


class PathReply(Reply):
    """The way against the limits. A ramp never goes beyond its target, so the ends of the way are all."""

    lowest: Quantity = Field(description="The lowest position on the way.")
    highest: Quantity
    limit_low: Quantity = Field(description="The lowest position that the axis may be sent to.")
    limit_high: Quantity
    within: bool = Field(description="Whether the whole way lies within the limits.")


class PreviewReply(Reply):
    """A command that was not given: nothing was sent, no operation was made, no key was spent."""

    model_config = examples.shown(examples.PREVIEW)

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
