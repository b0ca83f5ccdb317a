"""What many models share: the two bases, numbers, problems."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

from app.http import examples


class Request(BaseModel):
    """A body that a client sends: strict types, finite numbers, no unknown fields."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


# Checked before their unions, which would give an error for each of their types instead of one sentence.


def _number(value: object) -> int | float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PydanticCustomError("number", "must be a number")
    if isinstance(value, float) and not math.isfinite(value):
        raise PydanticCustomError("number", "must be a finite number")
    return value


def _rate(value: object) -> int | float | None:
    if value is None:
        return None
    if (number := _number(value)) <= 0:
        raise PydanticCustomError("rate", "must be above 0")
    return number


def _scalar(value: object) -> int | float | str | bool:
    if isinstance(value, str | bool):
        return value
    if not isinstance(value, int | float):
        raise PydanticCustomError("scalar", "must be a number, a text, true or false")
    return _number(value)


Number = Annotated[int | float, BeforeValidator(_number)]
"""A finite number; it stays whole if it was written without point and exponent."""
Rate = Annotated[Annotated[int, Field(gt=0)] | Annotated[float, Field(gt=0)] | None, BeforeValidator(_rate)]
"""A speed or an acceleration, without a direction; None: what the axis is configured with."""
Scalar = Annotated[int | float | str | bool, BeforeValidator(_scalar)]
"""The value of an object."""


class Reply(BaseModel):
    """A body that the service sends."""

    model_config = ConfigDict(frozen=True)


class NoBody(Request):
    """Nothing to say: an empty object, or no body at all. The content type is JSON all the same."""

    model_config = examples.shown({})


class ActionReply(Reply):
    """A request that can be sent as it is."""

    method: str = Field(examples=["POST"])
    path: str = Field(examples=["/api/v1/nodes/1/axes/0/enable"])
    body: dict[str, str]


class ObstacleReply(Reply):
    """One thing that prevents a command now, and what to do about it."""

    code: str = Field(examples=["not_enabled"])
    message: str = Field(examples=["The axis is not enabled."])
    remedy: str = Field(examples=["Enable the axis."])
    action: ActionReply | None = Field(
        default=None, description="What does it; None: it takes waiting, or a person's hands."
    )


class FieldError(Reply):
    """One field of a request that doesn't fit."""

    field: str = Field(description="Name of the field or parameter.", examples=["target"])
    message: str = Field(examples=["must be a number"])
    rule: str | None = Field(default=None, description="Stable name of the rule that a setting breaks.")


class Problem(Reply):
    """What went wrong, for a person and for a program (RFC 9457)."""

    model_config = ConfigDict(frozen=True, extra="allow")

    type: str = Field(description="Relative reference to the description of this kind of problem.")
    title: str
    status: int
    detail: str = Field(description="What happened, as a sentence.")
    code: str = Field(description="Stable name for programs.")
    hint: str = Field(description="What to do about it.")
    instance: str | None = Field(default=None, description="The path that was asked for.")
    node: int | None = Field(default=None, description="Node ID.")
    axis: int | None = Field(default=None, description="Axis number.")
    index: str | None = Field(default=None, description="Object index, hexadecimal.")
    sub: int | None = Field(default=None, description="Object sub-index.")
    abort_code: str | None = Field(default=None, description="SDO abort code, hexadecimal.")
    abort_meaning: str | None = None
    outcome: Literal["unknown", "refused", "not_sent"] | None = Field(
        default=None,
        description="What a failed object transfer did to the node: `unknown` may have taken effect, so read "
        "back before anything else; `refused` and `not_sent` did nothing.",
    )
    obstacles: list[ObstacleReply] | None = None
    point: int | None = Field(default=None, description="Where a path fails first: the point, from 0.")
    time_s: float | None = Field(default=None, description="Where a path fails first: its time.")
    quantity: str | None = Field(
        default=None,
        description="What fails there: time, start, position, velocity, acceleration or deceleration.",
    )
    value: float | None = Field(default=None, description="Of `quantity`, in steps and seconds.")
    limit: float | None = Field(default=None, description="Of `quantity`, in steps and seconds.")
    errors: list[FieldError] | None = None
    operation: str | None = Field(default=None, description="Path of the operation that holds the axis.")
    owner: str | None = Field(default=None, description="Who has the lease.")
    expires_in_s: float | None = Field(default=None, description="Seconds until the lease expires.")
