"""Named positions on the wire."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from app.axes.schemas import Quantity, Unit
from app.http import examples
from app.http.schemas import Number, Reply, Request

NAME = r"^[A-Za-z0-9](?:[A-Za-z0-9 ._-]{0,62}[A-Za-z0-9])?$"
"""Letters, digits, and within it blanks, points, hyphens and underscores; at most 64 of them."""
PositionName = Annotated[
    str,
    Field(pattern=NAME, max_length=64, description="Name of a taught position.", examples=["park"]),
]


class TeachBody(Request):
    """A position to keep; without one, where the axis stands."""

    model_config = examples.shown({"position": 51200, "unit": "steps"})

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


_NAMED_POSITION: examples.Example = {
    "name": "park",
    "position": {"steps": 51200, "value": 51200.0, "unit": "steps"},
    "unreferenced": False,
    "within_limits": True,
    "taught": examples.TIME,
    "taught_by": "anonymous",
}


class NamedPositionReply(Reply):
    """A position with a name."""

    model_config = examples.shown(_NAMED_POSITION)

    name: str
    position: Quantity = Field(description="In the unit that it was taught in, if the axis still has that.")
    unreferenced: bool = Field(description="Whether the axis goes there though it was not homed.")
    within_limits: bool = Field(description="Whether the axis may go there with its present travel limits.")
    taught: datetime
    taught_by: str = Field(description="The name of the token.")


class NamedPositionList(Reply):
    """The positions of an axis, by name."""

    model_config = examples.shown({"positions": [_NAMED_POSITION]})

    positions: list[NamedPositionReply]
