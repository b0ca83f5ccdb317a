"""Which set points each cycle sends: row after row of a path, and how to come to rest on it at any moment.

Pure: no clock, no I/O. A row is one set point for each axis, in steps and parts of a step: only what is sent
is rounded, so that a ramp is even however short the cycle. The rows come in pieces, ahead of their time.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Iterable, Sequence

Row = Sequence[float]

_HALVINGS = 20
"""How finely the pace of a ramp is chosen: to a millionth."""
_SLACK = 1e-3
"""By how much a ramp may be steeper than wanted, relative: so that it ends, and not a cycle later."""
_RAMPS = math.log((1.0 + _SLACK) / _SLACK) / 2
"""See `rows_to_rest`."""


class Cause(enum.StrEnum):
    """Why the path was left before its end."""

    NONE = "none"
    """It was not."""
    ASKED = "asked"
    """A stop."""
    UNDER_RUN = "under_run"
    """The rows came too late: fewer were left than coming to rest takes."""
    ORPHANED = "orphaned"
    """Whoever gives the rows is gone."""


def rows_to_rest(speed: float, braking: float) -> int:
    """How many rows coming to rest takes at most, wherever on a path it begins, for an axis that is nowhere
    faster than `speed` (steps a cycle; `braking` as in `Playback`).

    On a straight line the time of half a ramp is enough. But where the path slows an axis down by all of its
    braking, hardly anything is left to slow the path down, and the next moment another axis may be the one:
    only the slack is left then, of which the path's slowing down makes more and more. With u the square of
    the pace and s the way in ramps, du/ds = -2 (1 + slack - u), from u = 1 down to 0.
    """
    return math.ceil(_RAMPS * speed / braking)


class Playback:
    """The rows of one path, in order.

    Coming to rest slows the time of the path: the axes stay on it, in step with each other, and no axis's
    speed falls by more than its `braking` a cycle; where the path itself is steeper than that, by no more
    than its steepest part. Where rows end before the axes stand, the last one is the end, however fast they
    are: so `reserve` rows are kept back for it.
    """

    def __init__(
        self, start: Row, braking: Sequence[float], reserve: int, steepest: Sequence[float] | None = None
    ) -> None:
        """`start`: where the axes stand. `braking`: steps/cycle2, each axis's deceleration; above 0.
        `steepest`: as much, the most by which the path itself changes each axis's speed; none: no more.
        """
        self._braking = tuple(braking)
        self._steepest = tuple(map(max, self._braking, steepest or self._braking))
        self._reserve = reserve
        self._rows: deque[Row] = deque()
        self._here = start
        """Where the path is now; between two rows while slowing down."""
        self._before = start
        """The last row taken."""
        self._speed: Row = (0.0,) * len(start)
        """Steps in the last cycle."""
        self._share = 0.0
        """How far on the way from the last row taken to the next."""
        self._pace = 1.0
        self._last = False
        self.taken = 0
        """Rows that lie behind."""
        self.cause = Cause.NONE
        self.abrupt = False
        """Whether the rows ended before the axes had come to rest."""
        self.standing = False
        """Whether nothing more is to be sent."""

    @property
    def waiting(self) -> int:
        """Rows that were given and not yet taken."""
        return len(self._rows)

    def feed(self, rows: Iterable[Row]) -> None:
        """The next rows."""
        self._rows.extend(rows)

    def finish(self) -> None:
        """No more rows follow: the last one is where the path ends, at rest."""
        self._last = True

    def brake(self, cause: Cause) -> None:
        """Come to rest on the path, from the next cycle on. Nothing takes it back."""
        if self.cause is Cause.NONE and not self.standing:
            self.cause = cause

    def next(self) -> tuple[int, ...] | None:
        """What this cycle sends, whole steps; None once there is nothing more."""
        if self.standing:
            return None
        if self.cause is Cause.NONE and not self._last and len(self._rows) <= self._reserve:
            self.cause = Cause.UNDER_RUN
        row = self._follow() if self.cause is Cause.NONE else self._slow_down()
        if row is None:
            self.standing = True
            return None
        self._speed = tuple(new - old for new, old in zip(row, self._here, strict=True))
        self._here = row
        return tuple(round(value) for value in row)

    def _follow(self) -> Row | None:
        if not self._rows:
            return None
        self._before = self._take()
        return self._before

    def _take(self) -> Row:
        self.taken += 1
        return self._rows.popleft()

    def _slow_down(self) -> Row | None:
        if self._can(0.0, self._braking):
            return None
        if not self._rows:
            self.abrupt = not self._last
            return None
        pace = self._pace
        most = self._braking if self._can(pace, self._braking) else self._steepest
        if self._can(pace, most):
            low = 0.0
            for _ in range(_HALVINGS):
                middle = (low + pace) / 2
                low, pace = (low, middle) if self._can(middle, most) else (middle, pace)
        self._pace = pace
        there = self._at(pace)
        self._share += pace
        while self._share >= 1.0 and self._rows:
            self._share -= 1.0
            self._before = self._take()
        return there

    def _can(self, pace: float, limits: Sequence[float]) -> bool:
        """Whether going on by this share of a cycle changes every axis's speed by no more than its limit."""
        there = self._at(pace)
        return all(
            abs(new - old - speed) <= most * (1.0 + _SLACK)
            for new, old, speed, most in zip(there, self._here, self._speed, limits, strict=True)
        )

    def _at(self, pace: float) -> Row:
        """Where the path is after a share of a cycle; the end of the rows if that is nearer."""
        ahead = self._share + pace
        whole = int(ahead)
        rows = self._rows
        if whole >= len(rows):
            return rows[-1] if rows else self._here
        first = self._before if whole == 0 else rows[whole - 1]
        part = ahead - whole
        return tuple(a + (b - a) * part for a, b in zip(first, rows[whole], strict=True))
