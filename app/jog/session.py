"""What a hold means: whether it counts, whether it begins something, and when a press is used up.

Pure: time is an argument (seconds, the event loop's clock). A press goes from a hold to a release. One that
ended otherwise, by silence, a stop or a refusal, is used up: its further holds count for nothing, so that a
network that flaps makes no axis stutter. Only a release makes room for the next.
"""

from __future__ import annotations

import enum

_ROUNDING = 0.001
"""Seconds by which what was seen may seem to lie ahead."""


class Hold(enum.Enum):
    """What became of a hold."""

    BEGINS = "begins"
    """It counts, and the axis is free: begin."""
    COUNTS = "counts"
    """It counts, and something is being begun, turns, or comes to rest."""
    STALE = "stale"
    """What its sender had seen is too old: it was under way for too long, or its sender doesn't read."""
    USED_UP = "used_up"
    """Its press has ended; a release must come first."""
    OUT_OF_ORDER = "out_of_order"
    """Its number is none above the last one's."""

    @property
    def counts(self) -> bool:
        """Whether it keeps the axis turning."""
        return self in (Hold.BEGINS, Hold.COUNTS)


class JogSession:
    """One client's presses on one axis."""

    def __init__(self, silence: float) -> None:
        """`silence`: seconds for which a hold counts, and that may have passed since what it had seen."""
        self._silence = silence
        self._sequence = -1
        self._press = 0
        self._turns_for = 0
        """The press for which the last one was begun."""
        self._pressed = False
        self._used_up = False
        self._busy = False
        self.held_at = -float("inf")
        """When the last hold came that counts."""

    @property
    def busy(self) -> bool:
        """Whether something is being begun, turns, or comes to rest."""
        return self._busy

    @property
    def used_up(self) -> bool:
        """Whether a release must come before the next hold counts."""
        return self._used_up

    def hold(self, sequence: int, now: float, seen: float) -> Hold:
        """A hold came; its sender had last seen what was sent at `seen`."""
        if sequence <= self._sequence:
            return Hold.OUT_OF_ORDER
        self._sequence = sequence
        if not -_ROUNDING <= now - seen <= self._silence:
            return Hold.STALE
        if self._used_up:
            return Hold.USED_UP
        self._pressed = True
        self.held_at = now
        if self._busy:
            return Hold.COUNTS
        self._busy = True
        return Hold.BEGINS

    def release(self) -> None:
        """The press is over; the next hold is of another."""
        self._pressed = self._used_up = False
        self._press += 1

    def use_up(self) -> None:
        """What the press asks for can't be: none of its holds counts any more."""
        self._pressed, self._used_up = False, True

    def begins(self, now: float) -> bool:
        """Whether what a hold began is still wanted, now that it can be begun. It ends with `at_rest`."""
        if self._pressed and now - self.held_at < self._silence:
            self._turns_for = self._press
            return True
        self.refused()
        return False

    def refused(self) -> None:
        """What a hold began can't be."""
        self._busy = False
        if self._pressed:
            self.use_up()

    def at_rest(self, *, released: bool) -> None:
        """What was begun is over; `released`: by the release of its press."""
        self._busy = False
        if not released and self._turns_for == self._press:
            self.use_up()
