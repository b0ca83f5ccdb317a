"""Where moves were meant to end: a relative move starts from there, so that rounding doesn't add up."""

from __future__ import annotations

from fractions import Fraction

from drivers.master.axis.axis import Axis
from drivers.master.axis.outlook import starting_point
from drivers.master.plan.requests import OnBusy


class Meant:
    """Where the last move of each axis was meant to end, in parts of a step.

    A relative move that begins where the axis was sent starts from what was meant: ten moves by a third of a
    step end where one by ten thirds does, at most half a step from it, queued ones too. One that begins
    anywhere else (after a stop, a homing, a jog) starts from there.
    """

    def __init__(self) -> None:
        self._places: dict[Axis, Fraction] = {}

    def target(
        self, axis: Axis, target: Fraction, on_busy: OnBusy, *, relative: bool
    ) -> tuple[int, Fraction | None]:
        """The steps that a move is commanded with, and the position that is meant; None: where it will begin
        is not known.
        """
        if not relative:
            return round(target), target
        begins_at = starting_point(axis, on_busy)
        if begins_at is None:
            return round(target), None
        last = self._places.get(axis)
        start = last if last is not None and round(last) == begins_at else Fraction(begins_at)
        return round(start + target) - begins_at, start + target

    def sent(self, axis: Axis, meant: Fraction | None) -> None:
        """The axis was told to go there, behind everything else that it was told."""
        if meant is None:
            self._places.pop(axis, None)
        else:
            self._places[axis] = meant
