"""One axis's settings, as a file or a client writes them, and the configuration in steps that comes of them.

A number may stand alone, then it is in the axis's own `unit`; or with its unit, as ``12.5 mm/s`` or
``{"value": 12.5, "unit": "mm/s"}``, in any unit of the axis. It is taken as written and rounded once, to the
nearest step, halves to even.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Annotated, Any, Literal, Self, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, model_validator

from drivers.errors import BadValue
from drivers.master.config import AxisConfig
from drivers.master.gearing import STEPS, Gearing, exact, micrometres

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,62}$")]
_MEASURE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)\s*([^\s\d].{0,23}?)?\s*")
_RATIO = re.compile(r"\s*(\d{1,15}(?:\.\d{1,15})?)\s*:\s*(\d{1,15}(?:\.\d{1,15})?)\s*")
_BEYOND = 2**63


class SettingsError(Exception):
    """The settings can't be used; the text says which key and why, one line for each."""


class Section(BaseModel):
    """A part of the tree; refuses keys that it doesn't know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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

POSITION, VELOCITY, ACCELERATION = "", "/s", "/s2"
Dimension = Literal["", "/s", "/s2"]
"""What follows the unit of length or angle."""
DIMENSIONS: Mapping[str, Dimension] = {
    "velocity": VELOCITY,
    "acceleration": ACCELERATION,
    "deceleration": ACCELERATION,
    "quick_stop_deceleration": ACCELERATION,
    "start_velocity": VELOCITY,
    "end_velocity": VELOCITY,
    "homing_fast": VELOCITY,
    "homing_slow": VELOCITY,
    "homing_acceleration": ACCELERATION,
    "home_offset": POSITION,
    "position_tolerance": POSITION,
}
"""The settings that are one length, speed or acceleration."""
_MAY_BE_NOTHING = frozenset({"start_velocity", "end_velocity", "position_tolerance"})
_GEARING = ("full_steps", "microsteps", "gear", "pitch", "direction")


class AxisSettings(Section):
    """One axis; what is left out keeps the driver's default, which is given in steps."""

    name: Name
    unit: str = Field(default=STEPS, pattern=r"^[A-Za-z°µμ%][A-Za-z0-9°µμ%]{0,15}$")
    steps_per_unit: float | None = Field(
        default=None,
        allow_inf_nan=False,
        description="Microsteps in one unit, where no gearing says it; negative turns the axis around.",
    )
    full_steps: int | None = Field(default=None, description="Full steps of a motor turn, 2001h; else 200.")
    microsteps: int | None = Field(default=None, description="Microsteps of a full step, 2000h; else 256.")
    gear: Gear | None = Field(default=None, description="Motor turns : output turns, e.g. 3:1.")
    pitch: Measure | None = Field(default=None, description="Length of an output turn, e.g. 5 mm.")
    direction: int | None = Field(default=None, description="-1 turns the axis around; else 1.")
    velocity: Measure | None = Field(default=None, description="unit/s")
    acceleration: Measure | None = Field(default=None, description="unit/s2")
    deceleration: Measure | None = Field(default=None, description="unit/s2")
    quick_stop_deceleration: Measure | None = Field(default=None, description="unit/s2")
    start_velocity: Measure | None = Field(default=None, description="unit/s")
    end_velocity: Measure | None = Field(default=None, description="unit/s")
    homing_method: int | None = Field(default=None, ge=-128, le=127)
    homing_fast: Measure | None = Field(default=None, description="unit/s")
    homing_slow: Measure | None = Field(default=None, description="unit/s")
    homing_acceleration: Measure | None = Field(default=None, description="unit/s2")
    soft_limits: tuple[Measure, Measure] | None = Field(default=None, description="unit; lower, upper")
    home_offset: Measure | None = Field(default=None, description="unit")
    position_tolerance: Measure | None = Field(default=None, description="unit; only with an encoder")
    switch_parameters: int | None = Field(default=None, ge=0, le=63, description="Object 2005h.")
    require_homing: bool | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        geared = [key for key in _GEARING if getattr(self, key) is not None]
        if self.steps_per_unit is not None and geared:
            raise ValueError(f"steps_per_unit must be left out where {geared[0]} is given")
        if self.steps_per_unit == 0:
            raise ValueError("steps_per_unit must not be 0")
        if self.unit == STEPS and self.steps_per_unit not in (None, 1.0):
            raise ValueError("steps_per_unit must be 1 where the unit is steps; name the unit, e.g. mm")
        for key in DIMENSIONS:
            measure = cast("Measure | None", getattr(self, key))
            if measure is None or key == "home_offset":
                continue
            if measure.value < 0 or (measure.value == 0 and key not in _MAY_BE_NOTHING):
                at_least = "at least" if key in _MAY_BE_NOTHING else "above"
                raise ValueError(f"{key} must be {at_least} 0")
        return self

    @property
    def gearing(self) -> Gearing | None:
        """Motor, gear and pitch, if any of them is given. Raises `SettingsError`."""
        given = {key: value for key in _GEARING if (value := getattr(self, key)) is not None}
        if not given:
            return None
        pitch = cast("Measure | None", given.pop("pitch", None))
        if pitch is not None:
            try:
                given["pitch_um"] = micrometres(pitch.value, pitch.unit or self.unit)
            except ValueError as error:
                raise SettingsError(f"axis {self.name}: pitch: {error}") from error
        return Gearing(**given)

    def to_config(self) -> AxisConfig:
        """The same in steps. Raises `SettingsError` for a number that is none of steps, `BadValue`."""
        units = AxisConfig(self.name, self.unit, self._per_unit, self.gearing)
        values: dict[str, Any] = {}
        for key, dimension in DIMENSIONS.items():
            measure = cast("Measure | None", getattr(self, key))
            if measure is None:
                continue
            steps = self._steps(key, measure, units, dimension)
            if key == "position_tolerance":
                steps = abs(steps)
            elif key != "home_offset":
                steps = max(1, abs(steps)) if measure.value else 0
            values[key] = steps
        for key in ("homing_method", "switch_parameters", "require_homing"):
            if (value := getattr(self, key)) is not None:
                values[key] = value
        if self.soft_limits is not None:
            values["soft_limits"] = self._limits(self.soft_limits, units)
        return AxisConfig(self.name, self.unit, self._per_unit, self.gearing, **values)

    @property
    def _per_unit(self) -> float:
        return 1 if self.steps_per_unit is None else self.steps_per_unit

    def _limits(self, given: tuple[Measure, Measure], units: AxisConfig) -> tuple[int, int]:
        lower, upper = (self._steps("soft_limits", limit, units, POSITION) for limit in given)
        return (upper, lower) if units.steps_per_unit < 0 else (lower, upper)

    def _steps(self, key: str, measure: Measure, axis: AxisConfig, dimension: Dimension) -> int:
        unit = axis.unit + dimension if measure.unit is None else measure.unit
        per_unit = axis.units.get(unit.removesuffix(dimension)) if unit.endswith(dimension) else None
        if per_unit is None:
            known = ", ".join(name + dimension for name in axis.units)
            raise SettingsError(
                f"axis {self.name}: {key}: {unit!r} is none of its units, which are {known} here"
            )
        steps = exact(measure.value) * per_unit
        if abs(steps) >= _BEYOND:
            raise SettingsError(f"axis {self.name}: {key}: {measure} is no number of steps")
        return round(steps)


def config_of(settings: AxisSettings) -> AxisConfig:
    """`AxisSettings.to_config`, with what the drivers refuse as a `SettingsError` too."""
    try:
        return settings.to_config()
    except BadValue as error:
        raise SettingsError(error.message) from error
