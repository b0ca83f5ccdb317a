"""Numbers with their units, as a file or a client writes them, and what an axis counts in each unit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PlainSerializer,
    model_validator,
)
from pydantic_core import CoreSchema

from drivers.master.plan.axis_fields import SETTINGS
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.gearing import exact
from drivers.master.plan.setting import Dimension

_MEASURE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)\s*([^\s\d].{0,23}?)?\s*")
_RATIO = re.compile(r"\s*(\d{1,15}(?:\.\d{1,15})?)\s*:\s*(\d{1,15}(?:\.\d{1,15})?)\s*")


class Measure(BaseModel):
    """A number with its unit; without one it is in the axis's own."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    value: int | float
    unit: str | None = Field(default=None, max_length=24)

    @model_validator(mode="before")
    @classmethod
    def _read(cls, given: object) -> object:
        if isinstance(given, bool):
            raise ValueError("a number is expected")
        if isinstance(given, int | float):
            return {"value": given}
        if isinstance(given, str):
            found = _MEASURE.fullmatch(given)
            if found is None:
                raise ValueError("a number is expected, with its unit if it has another than the axis")
            return {"value": _number(found[1]), "unit": found[2]}
        return given

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """All that is read; what is shown is always the object."""
        with_unit = handler(schema)
        return {
            "title": "Measure",
            "description": "A number with its unit; alone (in a file only) it is in the axis's own.",
            "anyOf": [with_unit, {"type": "string", "examples": ["12.5 mm/s"]}, {"type": "number"}],
        }

    def __str__(self) -> str:
        return f"{self.value}" if self.unit is None else f"{self.value} {self.unit}"


def _number(text: str) -> int | float:
    return int(text) if text.lstrip("+-").isdecimal() else float(text)


def _read_gear(given: object) -> object:
    """``3:1``, ``[3, 1]`` or 3: turns of the motor to turns of the output."""
    match given:
        case [int() | float() as motor, int() | float() as output]:
            pass
        case str() if found := _RATIO.fullmatch(given):
            motor, output = _number(found[1]), _number(found[2])
        case bool():
            raise ValueError("a ratio is expected, e.g. 3:1")
        case int() | float():
            motor, output = given, 1
        case Fraction():
            return given
        case _:
            raise ValueError("a ratio is expected, e.g. 3:1")
    if not (math.isfinite(motor) and math.isfinite(output) and output):
        raise ValueError("both parts of a ratio must be above 0")
    return exact(motor) / exact(output)


def write_gear(gear: Fraction) -> str:
    """As `gear` is written in a settings file."""
    return f"{gear.numerator}:{gear.denominator}"


Gear = Annotated[
    Fraction,
    BeforeValidator(_read_gear, json_schema_input_type=str),
    PlainSerializer(write_gear, return_type=str),
]
DIMENSIONS: Mapping[str, Dimension] = {
    name: row.dimension for name, row in SETTINGS.items() if row.dimension is not None
}
"""The settings that are one number with a unit."""
_TIMES: Mapping[str, Fraction] = {"ms": Fraction(1000), "s": Fraction(1_000_000), "us": Fraction(1)}
"""Microseconds in each unit of time."""
_CURRENTS: Mapping[str, Fraction] = {"%": Fraction(255, 100), "1/255": Fraction(1)}
"""255ths of the full current in each unit of current."""


def units_of(key: str, axis: AxisConfig) -> dict[str, Fraction]:
    """What the setting's object counts, in one of each unit that the setting may be given in."""
    dimension = DIMENSIONS[key]
    if dimension is Dimension.CURRENT:
        return dict(_CURRENTS)
    if dimension is Dimension.TIME:
        return {unit: size / SETTINGS[key].tick_us for unit, size in _TIMES.items()}
    return {unit + dimension: size for unit, size in axis.units.items()}


def unit_of(key: str, unit: str) -> str:
    """The unit of a number that stands alone, on an axis with this unit."""
    dimension = DIMENSIONS[key]
    return dimension.value if dimension.has_own_unit else unit + dimension
