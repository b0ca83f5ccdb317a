"""Objects of a module on the wire."""

from __future__ import annotations

from pydantic import Field

from app.http import examples
from app.http.schemas import Reply, Request, Scalar


class MeaningReply(Reply):
    """What a set bit, or the value, says."""

    name: str
    title: str
    cause: str
    remedy: str


_OBJECT: examples.Example = {
    "node": 1,
    "index": "0x6064",
    "sub": 0,
    "name": "Position actual value",
    "type": "I32",
    "access": "ro",
    "unit": "steps",
    "value": 51200,
    "meanings": [],
}


class ObjectReply(Reply):
    """The value of one object; bytes are shown in hexadecimal."""

    model_config = examples.shown(_OBJECT)

    node: int
    index: str
    sub: int
    name: str
    type: str
    access: str
    unit: str
    value: int | float | str | bool
    meanings: list[MeaningReply] = Field(
        description="For flags: each bit that is set. For option codes: the value."
    )


class ObjectBody(Request):
    """A value to write past the axis."""

    model_config = examples.shown({"value": 51200, "confirm": False})

    value: Scalar
    confirm: bool = Field(default=False, description="Needed for objects that could endanger motion.")
