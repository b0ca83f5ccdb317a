"""Absolute deadlines, and how late each of them was met. Pure: the time is an argument."""

from __future__ import annotations

import math
from collections.abc import Mapping

_FINENESS = 16
"""Buckets of the histogram to a doubling: a figure is right to 4.5 per cent."""


class Lateness:
    """A histogram of delays in logarithmic buckets; as small after a million as after one."""

    def __init__(self, counts: Mapping[int, int] | None = None, longest: float = 0.0) -> None:
        self.counts = dict(counts or {})
        self.longest = longest
        """Seconds."""

    def add(self, seconds: float) -> None:
        """One more; early counts as in time."""
        microseconds = max(0.0, seconds * 1e6)
        bucket = math.ceil(_FINENESS * math.log2(1.0 + microseconds))
        self.counts[bucket] = self.counts.get(bucket, 0) + 1
        self.longest = max(self.longest, seconds)

    def share(self, share: float) -> float:
        """Seconds that this share of them (0..1) did not exceed; 0 if there are none."""
        rank = share * sum(self.counts.values())
        for bucket in sorted(self.counts):
            rank -= self.counts[bucket]
            if rank <= 0:
                return min(self.longest, (2.0 ** (bucket / _FINENESS) - 1.0) * 1e-6)
        return self.longest


class Pace:
    """When the next cycle is due.

    A deadline doesn't move with the lateness of the one before. One that is missed by a whole cycle is
    another matter: the cycles that are lost are not made good, which would be a leap; the rest of the path is
    that much later (`slips`).
    """

    def __init__(self, period: float, start: float) -> None:
        self.period = period
        self.due = start
        self.met = 0
        self.slips = 0
        self.lateness = Lateness()

    def begun(self, now: float) -> None:
        """The cycle that was due has begun."""
        late = now - self.due
        self.met += 1
        self.lateness.add(late)
        if late >= self.period:
            self.slips += 1
            self.due = now
        self.due += self.period
