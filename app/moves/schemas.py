"""The bodies of the commands that move one axis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from pydantic import Field, WrapValidator, model_validator
from pydantic_core import PydanticCustomError

from app.axes.schemas import Unit
from app.http import examples
from app.http.schemas import Number, Rate, Request
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
