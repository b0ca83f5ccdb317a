"""The bodies of the commands that move one axis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from pydantic import Field, WrapValidator, model_validator
from pydantic_core import PydanticCustomError

from app.axes.schemas import ChangeReply, Quantity, Unit
from app.http import examples
from app.http.schemas import Number, ObstacleReply, Rate, Reply, Request
from app.positions.schemas import PositionName

OnBusyChoice = Annotated[
    Literal["reject", "replace", "queue"],
    Field(
        description="If something else holds the axis: `reject` refuses the command; `replace` cancels what "
        "runs and what waits, and begins once the axis stands; `queue` begins once everything before it has "
        "succeeded."
    ),
]
_MOVE: examples.Example = {
    "target": 51200,
    "relative": False,
    "unit": "steps",
    "velocity": 51200,
    "acceleration": 102400,
}


class MoveBody(Request):
    """Go to a position, or by a distance. What is left out comes from the axis's settings."""

    model_config = examples.shown(_MOVE)

    target: Number = Field(description="Position or distance in `unit`; whole where the unit is steps.")
    unit: Unit
    relative: bool = Field(default=False, description="Whether `target` is a distance from here.")
    velocity: Rate = Field(default=None, description="`unit`/s")
    acceleration: Rate = Field(default=None, description="`unit`/s2")
    deceleration: Rate = Field(default=None, description="`unit`/s2")
    on_busy: OnBusyChoice = "reject"


class VelocityBody(Request):
    """Run at a speed, until something else is commanded or to at most one of three ends; 0 stops."""

    model_config = examples.shown({"velocity": 100000, "unit": "steps"})

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

    model_config = examples.shown({"method": 19})

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

    model_config = examples.shown({"position": 0, "unit": "steps"})

    position: Number = Field(description="In `unit`; whole where the unit is steps.")
    unit: Unit
    shift_limits: bool = Field(
        default=False,
        description="Needed where the axis was homed and has travel limits: they are counted in its "
        "positions, so another position for the same place moves them.",
    )


class GoBody(Request):
    """Go to a named position. What is left out comes from the axis's settings."""

    model_config = examples.shown({"position": "park"})

    position: PositionName
    unit: Unit | None = Field(default=None, description="Needed with any speed or acceleration.")
    velocity: Rate = Field(default=None, description="`unit`/s")
    acceleration: Rate = Field(default=None, description="`unit`/s2")
    deceleration: Rate = Field(default=None, description="`unit`/s2")
    on_busy: OnBusyChoice = "reject"

    @model_validator(mode="after")
    def _check(self) -> Self:
        rates = (self.velocity, self.acceleration, self.deceleration)
        if self.unit is None and any(rate is not None for rate in rates):
            raise PydanticCustomError("teach", "must name the unit of its speeds and accelerations")
        return self


class NamedMove(MoveBody):
    """A move to a named position, looked up."""

    position: str


def _choose(value: object, handler: Callable[[Any], MoveBody | GoBody]) -> MoveBody | GoBody:
    """One model by what the body has, so that its errors are those of one."""
    del handler
    kind = GoBody if isinstance(value, dict) and "position" in value else MoveBody
    return kind.model_validate(value)


MoveOrGoBody = Annotated[MoveBody | GoBody, WrapValidator(_choose)]
"""What a move takes: a target, or the name of a position."""


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
