"""Between a user's unit and the module's microsteps, exactly: ratios of whole numbers, rounded once.

The drivers think in steps only; this is the one bridge. Halves are rounded to even. That errors don't add up
over relative moves is seen to by `app.moves.meant`.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from app.axes.schemas import Quantity
from app.http.problems import ApiError
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.gearing import STEPS, exact, shown

_BEYOND = 2**63
"""Steps that no object could hold."""


@dataclass(frozen=True, slots=True)
class Scale:
    """A unit of one axis: how many steps are in it."""

    unit: str
    steps_per_unit: Fraction | float

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps_per_unit", exact(self.steps_per_unit))

    @classmethod
    def named(cls, unit: str, axis: AxisConfig) -> Scale:
        """The unit that a client named. Raises `ApiError` (422) if the axis has no such unit."""
        per_unit = axis.units.get(unit)
        if per_unit is not None:
            return cls(unit, per_unit)
        known = [STEPS, *(name for name in axis.units if name != STEPS and name.isascii())]
        raise ApiError(
            "bad_value",
            f"Axis {axis.name} doesn't know the unit {unit!r}.",
            hint=f"Give the number in {_either(known)}.",
        )

    @classmethod
    def of(cls, axis: AxisConfig) -> Scale:
        """The unit that the axis is configured with."""
        return cls(axis.unit, axis.steps_per_unit)

    @property
    def ratio(self) -> Fraction:
        """`steps_per_unit`, exactly."""
        assert isinstance(self.steps_per_unit, Fraction), "made exact when the scale was made"
        return self.steps_per_unit

    def exact(self, field: str, value: float) -> Fraction:
        """A position or speed in steps and parts of a step. Raises `ApiError` (422) if it can't be one."""
        if self.unit == STEPS and not isinstance(value, int):
            raise ApiError(
                "bad_value",
                f"{field}: steps are whole numbers, not {value}.",
                hint="Write it without point and exponent, e.g. 1000.",
            )
        found = exact(value) * self.ratio
        if abs(found) >= _BEYOND:
            raise ApiError(
                "bad_value", f"{field}: the number is out of all range.", hint=f"Give another {field}."
            )
        return found

    def steps(self, field: str, value: float) -> int:
        """A position or speed in steps, rounded to the nearest, halves to even.

        Raises `ApiError` (422) if it can't be one.
        """
        if isinstance(value, int) and self.unit == STEPS:
            return value
        return round(self.exact(field, value))

    def rate(self, field: str, value: float | None) -> int | None:
        """A speed or acceleration without direction, in steps; at least 1, since 0 would mean to stand."""
        if value is None:
            return None
        return max(1, abs(self.steps(field, value)))

    def value(self, steps: int) -> float:
        """Steps in this unit: the nearest float, so that it comes back to the same step."""
        ratio = self.ratio
        return (steps * ratio.denominator) / ratio.numerator

    def quantity(self, steps: int, suffix: str = "") -> Quantity:
        """What the wire shows of a number of steps; `suffix` is ``/s`` for a speed."""
        return Quantity(steps=steps, value=self.value(steps), unit=self.unit + suffix)

    def commanded(self, field: str, value: float, steps: int) -> dict[str, Any]:
        """For the request of an operation: what `field` came to, and by how much it was rounded, in `unit`.

        `rounded_by` is what is commanded less what was asked.
        """
        done = Fraction(steps) / self.ratio
        return {
            f"{field}_steps": steps,
            f"{field}_commanded": shown(done),
            "rounded_by": shown(done - exact(value)),
        }


def _either(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
