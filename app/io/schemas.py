"""Inputs and outputs of a node on the wire, and waiting for an input."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from app.http import examples
from app.http.schemas import Number, Reply, Request


class DigitalInputReply(Reply):
    """A digital input."""

    number: int
    name: str = Field(description="As the manual calls it.", examples=["IN0"])
    on: bool


class AnalogInputReply(Reply):
    """An analog input."""

    number: int
    name: str = Field(examples=["AIN0"])
    raw: int = Field(description="As the converter has it: 0 to 4095 on a TMCM-3216.")
    volts: float | None = Field(
        description="None unless `analog_full_scale` of the node is set: the manual gives no scale."
    )


class SwitchReply(Reply):
    """A limit or home switch of an axis, from its last process data."""

    axis: int = Field(description="Axis number.")
    name: str = Field(examples=["x.home"])
    on: bool = Field(description="Whether it is pressed.")
    age_s: float | None = Field(description="Seconds since the module sent this; None if it never did.")
    stale: bool = Field(description="Whether this is too old to rely on.")


_INPUTS: examples.Example = {
    "node": 1,
    "digital": [{"number": 0, "name": "IN0", "on": True}],
    "analog": [{"number": 0, "name": "AIN0", "raw": 2048, "volts": None}],
    "switches": [{"axis": 0, "name": "x.home", "on": False, "age_s": 0.012, "stale": False}],
    "age_s": 0.003,
}


class InputsReply(Reply):
    """All inputs of a node now."""

    model_config = examples.shown(_INPUTS)

    node: int = Field(description="Node ID.")
    digital: list[DigitalInputReply]
    analog: list[AnalogInputReply]
    switches: list[SwitchReply]
    age_s: float = Field(description="Seconds since `digital` and `analog` were asked for.")


_OUTPUT: examples.Example = {
    "node": 1,
    "number": 0,
    "name": "OUT0",
    "on": True,
    "usable": True,
    "push_pull": False,
}


class OutputReply(Reply):
    """A digital output as the module holds it."""

    model_config = examples.shown(_OUTPUT)

    node: int = Field(description="Node ID.")
    number: int
    name: str = Field(examples=["OUT0"])
    on: bool
    usable: bool = Field(description="Whether the pin is an output (2711h), so that it can be switched.")
    push_pull: bool = Field(description="Whether it drives both levels; else the high side only (2711h).")


class OutputsReply(Reply):
    """All outputs of a node."""

    model_config = examples.shown({"outputs": [_OUTPUT]})

    outputs: list[OutputReply]


class OutputBody(Request):
    """What the output is to be."""

    model_config = examples.shown({"on": True})

    on: bool


def _input_name(value: object) -> int | str | None:
    if value is None or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    if isinstance(value, str) and 0 < len(value) <= 128:
        return value
    raise PydanticCustomError("input_name", "must be an input's number or name")


class WaitBody(Request):
    """An input, and what it is waited for to do: a digital one with `becomes`, or an analog one."""

    model_config = examples.shown({"input": "IN0", "becomes": True, "timeout_s": 30})

    input: Annotated[int | str | None, BeforeValidator(_input_name)] = Field(
        default=None, description="A digital input by number or name (`IN0`), or a switch (`x.home`)."
    )
    becomes: bool | None = Field(default=None, description="What the digital input is to be.")
    analog: int | None = Field(default=None, ge=0, le=254, description="An analog input by number.")
    above: Number | None = Field(default=None, description="In `unit`: until the analog input is above it.")
    below: Number | None = Field(default=None, description="In `unit`: until the analog input is below it.")
    unit: Literal["V", "raw"] | None = Field(
        default=None,
        description="Of `above` or `below`: volts, where `analog_full_scale` of the node is set, or the "
        "converter's own counts.",
    )
    timeout_s: float = Field(default=30.0, gt=0, le=3600, description="Seconds it may take.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        digital = (self.input is not None, self.becomes is not None)
        others = (self.analog, self.above, self.below, self.unit)
        bounds = (self.above is None) is not (self.below is None)
        if all(digital) and all(other is None for other in others):
            return self
        if not any(digital) and self.analog is not None and bounds and self.unit is not None:
            return self
        raise PydanticCustomError(
            "wait", "must name input and becomes; or analog, its unit, and one of above and below"
        )
