"""A length or a speed, as the service tells it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Quantity:
    """A length or a speed: in microsteps (per second), and in the axis's unit."""

    steps: int
    value: float
    unit: str
