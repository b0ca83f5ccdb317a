"""What many models share: the two bases, quantities with their units, problems."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from app.schemas import examples


class Request(BaseModel):
    """A body that a client sends: strict types, finite numbers, no unknown fields."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Reply(BaseModel):
    """A body that the service sends."""

    model_config = ConfigDict(frozen=True)


class NoBody(Request):
    """Nothing to say: an empty object, or no body at all. The content type is JSON all the same."""

    model_config = examples.shown({})


Unit = Annotated[
    str,
    Field(
        min_length=1,
        max_length=16,
        description="`steps` (microsteps), or the unit that the axis is configured with.",
        examples=["steps"],
    ),
]


class Quantity(Reply):
    """A length or a speed: in steps as the module has it, and in the axis's unit."""

    steps: int = Field(description="Microsteps, or microsteps per second.")
    value: float = Field(description="The same in `unit`.")
    unit: str = Field(examples=["steps"])


class ObstacleReply(Reply):
    """One thing that prevents a command now, and what to do about it."""

    code: str = Field(examples=["not_enabled"])
    message: str = Field(examples=["The axis is not enabled."])
    remedy: str = Field(examples=["POST enable."])


class FieldError(Reply):
    """One field of a request that doesn't fit."""

    field: str = Field(examples=["body.target"])
    message: str = Field(examples=["Input should be a valid integer"])


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
    obstacles: list[ObstacleReply] | None = None
    errors: list[FieldError] | None = None
    operation: str | None = Field(default=None, description="Path of the operation that holds the axis.")
