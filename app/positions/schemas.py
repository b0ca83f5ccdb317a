"""Named positions on the wire."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Annotated, Any, Self

from pydantic import Field, WrapValidator, model_validator
from pydantic_core import PydanticCustomError

from app.axes.schemas import MoveBody
from app.http import examples
from app.http.schemas import Number, OnBusyChoice, Quantity, Rate, Reply, Request, Unit

NAME = r"^[A-Za-z0-9](?:[A-Za-z0-9 ._-]{0,62}[A-Za-z0-9])?$"
"""Letters, digits, and within it blanks, points, hyphens and underscores; at most 64 of them."""
PositionName = Annotated[
    str,
    Field(pattern=NAME, max_length=64, description="Name of a taught position.", examples=["park"]),
]


class TeachBody(Request):
    """A position to keep; without one, where the axis stands."""

    model_config = examples.shown(examples.TEACH)

    position: Number | None = Field(default=None, description="In `unit`; left out: where the axis stands.")
    unit: Unit | None = Field(
        default=None, description="Needed with `position`; without it, the unit to show it in."
    )
    unreferenced: bool = Field(
        default=False,
        description="Take it, and let the axis go there, though it was not homed: it counts from wherever "
        "the module started then.",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.position is not None and self.unit is None:
            raise PydanticCustomError("teach", "must name the unit of position")
        return self


class NamedPositionReply(Reply):
    """A position with a name."""

    model_config = examples.shown(examples.NAMED_POSITION)

    name: str
    position: Quantity = Field(description="In the unit that it was taught in, if the axis still has that.")
    unreferenced: bool = Field(description="Whether the axis goes there though it was not homed.")
    within_limits: bool = Field(description="Whether the axis may go there with its present travel limits.")
    taught: datetime
    taught_by: str = Field(description="The name of the token.")


class NamedPositionList(Reply):
    """The positions of an axis, by name."""

    model_config = examples.shown({"positions": [examples.NAMED_POSITION]})

    positions: list[NamedPositionReply]


class GoBody(Request):
    """Go to a named position. What is left out comes from the axis's settings."""

    model_config = examples.shown(examples.GO)

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
