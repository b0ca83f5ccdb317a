"""What waits for an axis: motions that were accepted and are not begun, first come, first served.

Something waits only while a motion runs before it, or while the axis comes to rest to make way for it;
whatever else happens to the axis empties the line, and what was in it is never begun.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from drivers.master.motions.motion import Motion

LONGEST = 16
"""Motions that may wait for one axis."""


class Waiting(NamedTuple):
    """One of them."""

    motion: Motion
    begin: Callable[[], None]
    """Checks anew whether it may, and begins it. Raises `CanaxisError`; then nothing was sent."""


class WaitingLine:
    """The line of one axis."""

    def __init__(self) -> None:
        self._line: deque[Waiting] = deque()

    def __len__(self) -> int:
        return len(self._line)

    @property
    def motions(self) -> tuple[Motion, ...]:
        """Who waits, the next first."""
        return tuple(waiting.motion for waiting in self._line)

    def join(self, waiting: Waiting) -> None:
        """Stand in line; there must be room, see `admit`."""
        assert len(self._line) < LONGEST, "it was asked before whether there is room"
        self._line.append(waiting)

    def next(self) -> Waiting | None:
        """Let the first one out of the line."""
        return self._line.popleft() if self._line else None

    def leave(self, motion: Motion, reason: str) -> bool:
        """Cancel one that waits, and those behind it, whose predecessor it is. False: it does not wait."""
        motions = self.motions
        if motion not in motions:
            return False
        at = motions.index(motion)
        left = [self._line.pop() for _ in range(len(motions) - at)]
        motion.give_up(reason)
        for waiting in reversed(left[:-1]):
            waiting.motion.give_up("The operation before it was cancelled.")
        return True

    def clear(self, reason: str) -> None:
        """Cancel everything that waits."""
        left = tuple(self._line)
        self._line.clear()
        for waiting in left:
            waiting.motion.give_up(reason)
