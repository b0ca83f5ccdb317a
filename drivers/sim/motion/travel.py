"""The mechanics that an axis moves: a carriage on a travel with two limit switches, a home switch and an
index pulse.

All places are in microsteps of the travel's own scale, which homing never changes; the motor's counter has
another zero. A switch's edge lies half a microstep before its first active place, so at rest no level is
ambiguous.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

SwitchName = Literal["negative", "positive", "home"]

HALF: Final = 0.5


@dataclass(frozen=True, slots=True)
class AxisSettings:
    """What an axis is built into. By default a linear axis of 40 turns, fit for every homing method."""

    start: int = 0
    """Where the carriage stands at power-on."""
    travel_min: int | None = -1_050_000
    """The hard end stop on the negative side, where the motor stalls; None for an endless axis."""
    travel_max: int | None = 1_050_000
    negative_limit: int | None = -1_000_000
    """The negative limit switch is active from here on downwards; None = no switch, never active."""
    positive_limit: int | None = 1_000_000
    home: tuple[int, int] | None = (100_000, 110_000)
    """First and last place at which the home switch is active."""
    index_pitch: int = 51_200
    """Distance of the encoder's index pulses; 0 = none."""
    index_phase: int = 12_800
    """Place of one index pulse."""
    normally_closed: bool = False
    """Whether the switches are wired so that they open when touched; 2005h bits 2, 3, 5 must then be set."""
    encoder_reversed: bool = False
    """Whether the encoder counts against the motor; 200Bh:2 must then be 1."""
    supply_voltage: float = 24.0
    """Volts."""
    temperature: float = 35.0
    """Of the motor driver, degrees Celsius."""
    load: float = 0.15
    """Share of the motor's torque that the mechanics take, 0..1. At 1 and beyond the motor stalls."""


class Levels(NamedTuple):
    """Which switches are active, after polarity (2005h bits 2, 3, 5), whether used or not."""

    negative: bool
    positive: bool
    home: bool


class SwitchParameters(NamedTuple):
    """2005h, decoded (manual §4.2.6)."""

    value: int

    @property
    def negative_used(self) -> bool:
        """Bit 0 clear: the left limit switch counts."""
        return not self.value & 1

    @property
    def positive_used(self) -> bool:
        """Bit 1 clear: the right limit switch counts."""
        return not self.value & 2

    @property
    def home_used(self) -> bool:
        """Bit 4 clear: the home switch counts."""
        return not self.value & 16

    def effective(self, levels: Levels) -> Levels:
        """The levels that the drive acts on: a switch that is not used is never active."""
        return Levels(
            levels.negative and self.negative_used,
            levels.positive and self.positive_used,
            levels.home and self.home_used,
        )


class Travel:
    """Switches and index pulses over the carriage's place, and the hands that press them."""

    def __init__(self, settings: AxisSettings) -> None:
        self.settings = settings
        self._pressed: set[SwitchName] = set()

    @property
    def pressed(self) -> frozenset[SwitchName]:
        """The switches that a hand presses now."""
        return frozenset(self._pressed)

    def press(self, switch: SwitchName) -> None:
        """Press a switch by hand; it stays active until released."""
        self._pressed.add(switch)

    def release(self, switch: SwitchName) -> None:
        """Take the hand away. The carriage itself may still press the switch."""
        self._pressed.discard(switch)

    def levels(self, place: float, parameters: SwitchParameters) -> Levels:
        """The switches at a place."""
        own = self.settings
        touched = Levels(
            "negative" in self._pressed
            or (own.negative_limit is not None and place < own.negative_limit + HALF),
            "positive" in self._pressed
            or (own.positive_limit is not None and place > own.positive_limit - HALF),
            "home" in self._pressed
            or (own.home is not None and own.home[0] - HALF < place < own.home[1] + HALF),
        )
        bits = parameters.value
        wired = own.normally_closed
        return Levels(
            touched.negative ^ wired ^ bool(bits & 4),
            touched.positive ^ wired ^ bool(bits & 8),
            touched.home ^ wired ^ bool(bits & 32),
        )

    def edges(self) -> Iterator[float]:
        """Every place at which a switch changes."""
        own = self.settings
        if own.negative_limit is not None:
            yield own.negative_limit + HALF
        if own.positive_limit is not None:
            yield own.positive_limit - HALF
        if own.home is not None:
            yield own.home[0] - HALF
            yield own.home[1] + HALF

    def end_stop(self, direction: int) -> int | None:
        """The hard stop in a direction."""
        return self.settings.travel_max if direction > 0 else self.settings.travel_min

    def next_index(self, place: float, direction: int) -> int | None:
        """The first index pulse strictly beyond a place."""
        pitch, phase = self.settings.index_pitch, self.settings.index_phase
        if not pitch or not direction:
            return None
        turns = (round(place) - phase) / pitch
        return phase + pitch * (math.floor(turns) + 1 if direction > 0 else math.ceil(turns) - 1)
