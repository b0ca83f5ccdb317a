"""Between a user's unit and the module's microsteps.

The drivers think in steps only; this is the one bridge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.problems import ApiError
from app.schemas.common import Quantity
from drivers.master.config import AxisConfig

STEPS = "steps"


@dataclass(frozen=True, slots=True)
class Scale:
    """A unit of one axis: how many steps are in it."""

    unit: str
    steps_per_unit: float

    @classmethod
    def named(cls, unit: str, axis: AxisConfig) -> Scale:
        """The unit that a client named. Raises `ApiError` (422) if the axis has no such unit."""
        if unit == STEPS:
            return cls(STEPS, 1.0)
        if unit == axis.unit:
            return cls.of(axis)
        known = STEPS if axis.unit == STEPS else f"{STEPS} or {axis.unit}"
        raise ApiError(
            "bad_value",
            f"Axis {axis.name} doesn't know the unit {unit!r}.",
            hint=f"Give the number in {known}.",
        )

    @classmethod
    def of(cls, axis: AxisConfig) -> Scale:
        """The unit that the axis is configured with."""
        return cls(axis.unit, axis.steps_per_unit)

    def steps(self, field: str, value: float) -> int:
        """A position or speed in steps, rounded to the nearest.

        Raises `ApiError` (422) if it can't be one.
        """
        if self.unit == STEPS:
            if isinstance(value, int):
                return value
            raise ApiError(
                "bad_value",
                f"{field}: steps are whole numbers, not {value}.",
                hint="Write it without point and exponent, e.g. 1000.",
            )
        try:
            return round(value * self.steps_per_unit)
        except (OverflowError, ValueError) as error:
            raise ApiError(
                "bad_value", f"{field}: the number is out of all range.", hint=f"Give another {field}."
            ) from error

    def rate(self, field: str, value: float | None) -> int | None:
        """A speed or acceleration without direction, in steps; at least 1, since 0 would mean to stand."""
        if value is None:
            return None
        return max(1, abs(self.steps(field, value)))

    def quantity(self, steps: int, suffix: str = "") -> Quantity:
        """What the wire shows of a number of steps; `suffix` is ``/s`` for a speed."""
        value = steps / self.steps_per_unit
        if not math.isfinite(value):  # a denormal steps_per_unit
            value = 0.0
        return Quantity(steps=steps, value=round(value, 9), unit=self.unit + suffix)
