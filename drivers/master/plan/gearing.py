"""What lies between a motor's microsteps and a length or an angle: exact ratios, never floats.

One turn of the motor is ``full_steps x microsteps`` (2001h, 2000h; manual §4.2.1, §4.2.2). A ratio that a
person writes in decimals is taken as written: 0.1 is a tenth here, not the nearest binary number.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

STEPS = "steps"
_LENGTHS: Mapping[str, Fraction] = {
    "mm": Fraction(1000),
    "um": Fraction(1),
    "µm": Fraction(1),  # the micro sign
    "μm": Fraction(1),  # the Greek letter, which looks the same
}
"""Micrometres in each unit of length."""
_ANGLES: Mapping[str, Fraction] = {"turns": Fraction(360), "deg": Fraction(1)}
"""Degrees in each unit of angle."""


def exact(value: float | Fraction) -> Fraction:
    """A number as its writer meant it: a float by its shortest decimal form. It must be finite."""
    return Fraction(repr(value)) if isinstance(value, float) else Fraction(value)


def micrometres(value: float | Fraction, unit: str) -> Fraction:
    """A length in micrometres. Raises ValueError for a unit that is no length."""
    if unit not in _LENGTHS:
        raise ValueError(f"{unit!r} is no unit of length; write it in mm or um")
    return exact(value) * _LENGTHS[unit]


def relatives(unit: str, per_unit: Fraction) -> dict[str, Fraction]:
    """Steps in one of each unit that follows from one: lengths from a length, angles from an angle."""
    for family in (_LENGTHS, _ANGLES):
        if unit in family:
            return {other: per_unit * (size / family[unit]) for other, size in family.items()}
    return {unit: per_unit}


@dataclass(frozen=True, slots=True)
class Gearing:
    """From the motor to the output. `AxisConfig` holds it against its rules."""

    full_steps: int = 200
    """Full steps in one turn of the motor: 2001h, 1..65535."""
    microsteps: int = 256
    """Microsteps in a full step: a power of 2, 1..256; 2000h holds its exponent."""
    gear: Fraction = Fraction(1)
    """Turns of the motor in one turn of the output."""
    pitch_um: Fraction | None = None
    """Micrometres that one turn of the output moves; None: nothing moves along a line."""
    direction: int = 1
    """-1 turns the axis around: its positive direction is the motor's negative one."""

    @property
    def microstep_exponent(self) -> int:
        """What 2000h holds."""
        return self.microsteps.bit_length() - 1

    @property
    def units(self) -> dict[str, Fraction]:
        """Steps in one of each unit, the direction in their sign."""
        turn = self.gear * (self.full_steps * self.microsteps * self.direction)
        known = relatives("turns", turn)
        if self.pitch_um is not None:
            known |= relatives("um", turn / self.pitch_um)
        return known


def shown(value: Fraction) -> float | int:
    """A number for a person or a wire: whole where it is whole, else the nearest float."""
    return value.numerator if value.denominator == 1 else float(value)


def written(value: Fraction) -> str:
    """The shortest text that `exact` reads back, for a length in a settings file."""
    number = shown(value)
    return str(number) if isinstance(number, int) else f"{Decimal(repr(number)):f}"
