"""One axis's settings, as a file or a client writes them, and the configuration in steps that comes of them.

A number may stand alone, then it is in the axis's own `unit`; or with its unit, as ``12.5 mm/s`` or
``{"value": 12.5, "unit": "mm/s"}``, in any unit of the axis. It is taken as written and rounded once, to the
nearest step, halves to even.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Annotated, Any, Self, cast

from pydantic import (
    ConfigDict,
    Field,
    model_validator,
)

from app.configuration.measures import DIMENSIONS, Gear, Measure, unit_of, units_of
from app.configuration.sections import ConfigurationError, Name, Section
from drivers.errors import BadValue
from drivers.master.plan.axis_fields import SETTINGS
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.gearing import STEPS, Gearing, exact, micrometres

_BEYOND = 2**63
_GEARING = ("full_steps", "microsteps", "gear", "pitch", "direction")


class AxisValues(Section):
    """What can be set of an axis; what is left out keeps the driver's default, which is given in steps."""

    model_config = ConfigDict(strict=True)

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
    velocity: Measure | None = Field(default=None, description="Of a move that names none; unit/s, 6081h.")
    acceleration: Measure | None = Field(default=None, description="unit/s2, 6083h.")
    deceleration: Measure | None = Field(default=None, description="unit/s2, 6084h.")
    max_velocity: Measure | None = Field(default=None, description="A command above it is refused; unit/s.")
    max_acceleration: Measure | None = Field(
        default=None,
        description="A command whose acceleration or deceleration is above it is refused; unit/s2.",
    )
    quick_stop_deceleration: Measure | None = Field(default=None, description="unit/s2, 6085h.")
    start_velocity: Measure | None = Field(default=None, description="VSTART; unit/s, 2010h.")
    end_velocity: Measure | None = Field(
        default=None, description="VSTOP, at least 10 steps/s and at least VSTART; unit/s, 6082h."
    )
    ramp_a1: Measure | None = Field(default=None, description="A1, up to V1; unit/s2, 2011h.")
    ramp_v1: Measure | None = Field(
        default=None, description="V1, at most V2; both 0: a trapezoid; unit/s, 2012h."
    )
    ramp_d1: Measure | None = Field(
        default=None, description="D1, below V1, never 0; unit/s2, 2013h; else the deceleration."
    )
    ramp_a2: Measure | None = Field(default=None, description="A2, from V1 to V2; unit/s2, 2016h.")
    ramp_v2: Measure | None = Field(default=None, description="V2; unit/s, 2017h.")
    ramp_d2: Measure | None = Field(
        default=None, description="D2, from V2 to V1, never 0; unit/s2, 2018h; else the deceleration."
    )
    ramp_wait: Measure | None = Field(default=None, description="Rest before the next ramp; ms, 2015h.")
    homing_method: int | None = Field(default=None, ge=-128, le=127, description="6098h.")
    homing_fast: Measure | None = Field(default=None, description="unit/s, 6099h:1.")
    homing_slow: Measure | None = Field(default=None, description="unit/s, 6099h:2.")
    homing_acceleration: Measure | None = Field(default=None, description="unit/s2, 609Ah.")
    soft_limits: Annotated[list[Measure], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="Lowest and highest target from machine home; unit, 607Dh."
    )
    home_offset: Measure | None = Field(default=None, description="unit, 607Ch.")
    position_tolerance: Measure | None = Field(
        default=None, description="How far from its target a finished move may read; unit; with an encoder."
    )
    position_window: Measure | None = Field(default=None, description="unit, 6067h.")
    position_window_time: Measure | None = Field(default=None, description="ms, 6068h.")
    following_error_window: Measure | None = Field(default=None, description="unit, 6065h; 0: never.")
    run_current: Measure | None = Field(default=None, description="% of the full current, 2003h.")
    standby_current: Measure | None = Field(default=None, description="% of the full current, 2004h.")
    standby_delay: Measure | None = Field(default=None, description="ms in steps of 10, 2089h.")
    encoder: bool | None = Field(default=None, description="Whether positions come from it, 606Ah.")
    encoder_resolution: int | None = Field(default=None, description="Increments of a turn, 608Fh:1.")
    encoder_null_polarity: int | None = Field(default=None, description="0 or 1, 200Bh:1.")
    encoder_direction: int | None = Field(default=None, description="1: opposite to the motor, 200Bh:2.")
    encoder_initialize: int | None = Field(default=None, description="1: positions begin with it, 200Bh:3.")
    brake_apply_current: Measure | None = Field(default=None, description="% of the full, 200Ch:1.")
    brake_release_current: Measure | None = Field(default=None, description="% of the full, 200Ch:2.")
    brake_apply_delay: Measure | None = Field(default=None, description="ms, 2002h:1.")
    brake_release_delay: Measure | None = Field(default=None, description="ms, 2002h:2.")
    enable_delay: Measure | None = Field(default=None, description="ms, 200Ah.")
    switch_parameters: int | None = Field(default=None, ge=0, le=63, description="Bits of 2005h.")
    require_homing: bool | None = Field(
        default=None, description="Whether absolute moves are refused until the axis was homed."
    )

    def measures(self) -> Iterator[tuple[str, Measure]]:
        """Every number with a unit that is given, with its setting."""
        for key in AxisValues.model_fields:
            measure = cast("Measure | None", getattr(self, key)) if key in DIMENSIONS else None
            if measure is not None:
                yield key, measure

    @model_validator(mode="after")
    def _check_signs(self) -> Self:
        for key, measure in self.measures():
            row = SETTINGS[key]
            if not row.signed and (measure.value < 0 or (measure.value == 0 and row.lowest == 1)):
                raise ValueError(f"{key} must be {'above' if row.lowest == 1 else 'at least'} 0")
        return self


class AxisSettings(AxisValues):
    """One axis, all of it."""

    name: Name

    @model_validator(mode="after")
    def _check_units(self) -> Self:
        geared = [key for key in _GEARING if getattr(self, key) is not None]
        if self.steps_per_unit is not None and geared:
            raise ValueError(f"steps_per_unit must be left out where {geared[0]} is given")
        if self.steps_per_unit == 0:
            raise ValueError("steps_per_unit must not be 0")
        if self.unit != STEPS and self.steps_per_unit is None and not geared:
            raise ValueError(f"the unit {self.unit} needs steps_per_unit, or a gearing (pitch, gear ...)")
        if self.unit == STEPS and self.steps_per_unit not in (None, 1.0):
            raise ValueError("steps_per_unit must be 1 where the unit is steps; name the unit, e.g. mm")
        return self

    @property
    def gearing(self) -> Gearing | None:
        """Motor, gear and pitch, if any of them is given. Raises `ConfigurationError`."""
        given = {key: value for key in _GEARING if (value := getattr(self, key)) is not None}
        if not given:
            return None
        pitch = cast("Measure | None", given.pop("pitch", None))
        if pitch is not None:
            try:
                given["pitch_um"] = micrometres(pitch.value, pitch.unit or self.unit)
            except ValueError as error:
                raise ConfigurationError(f"axis {self.name}: pitch: {error}") from error
        return Gearing(**given)

    def to_config(self) -> AxisConfig:
        """The same in steps. Raises `ConfigurationError` for a number that is none of steps, `BadValue`."""
        units = AxisConfig(self.name, self.unit, self._per_unit, self.gearing)
        values: dict[str, Any] = {}
        for key, measure in self.measures():
            row = SETTINGS[key]
            steps = self._steps(key, measure, units_of(key, units), unit_of(key, self.unit))
            counted = steps if row.signed else abs(steps)
            values[key] = max(1, counted) if row.lowest == 1 else counted
        plain = SETTINGS.keys() - DIMENSIONS.keys()
        values |= {key: value for key in plain if (value := getattr(self, key)) is not None}
        if self.soft_limits is not None:
            values["soft_limits"] = self._limits(self.soft_limits, units)
        return AxisConfig(self.name, self.unit, self._per_unit, self.gearing, **values)

    @property
    def _per_unit(self) -> float:
        return 1 if self.steps_per_unit is None else self.steps_per_unit

    def _limits(self, given: list[Measure], axis: AxisConfig) -> tuple[int, int]:
        lower, upper = (self._steps("soft_limits", limit, axis.units, self.unit) for limit in given)
        return (upper, lower) if axis.steps_per_unit < 0 else (lower, upper)

    def _steps(self, key: str, measure: Measure, units: Mapping[str, Fraction], alone: str) -> int:
        unit = alone if measure.unit is None else measure.unit
        size = units.get(unit)
        if size is None:
            raise ConfigurationError(
                f"axis {self.name}: {key}: {unit!r} is none of its units, which are {', '.join(units)} here"
            )
        counted = exact(measure.value) * size
        if abs(counted) >= _BEYOND:
            raise ConfigurationError(f"axis {self.name}: {key}: {measure} is no number of steps")
        return round(counted)

    def explicit(self) -> dict[str, Any]:
        """What is set, as JSON, every number with its unit."""
        given = self.model_dump(mode="json", exclude={"name"}, exclude_none=True)
        for key, _ in self.measures():
            given[key].setdefault("unit", unit_of(key, self.unit))
        lengths = [*given.get("soft_limits", ()), *([given["pitch"]] if "pitch" in given else [])]
        for measure in lengths:
            measure.setdefault("unit", self.unit)
        return given

    def written(self) -> dict[str, Any]:
        """As it stands in a settings file: every number with its unit, as ``12.5 mm/s``."""
        return {"name": self.name} | {key: _written(value) for key, value in self.explicit().items()}


def _written(value: object) -> object:
    if isinstance(value, Mapping):
        measure = cast("Mapping[str, Any]", value)
        return str(Measure.model_validate(measure))
    if isinstance(value, list):
        return [_written(item) for item in cast("list[object]", value)]
    return value


def config_of(settings: AxisSettings) -> AxisConfig:
    """`AxisSettings.to_config`, with what the drivers refuse as a `ConfigurationError` too."""
    try:
        return settings.to_config()
    except BadValue as error:
        raise ConfigurationError(error.message) from error
