"""Frames that wait until the interface takes them: bounded, urgent ones first, and never grown old."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection

from drivers.bus.frame import Frame


class Outbox:
    """Two queues, each with its own room, so that a flood of ordinary frames can't keep a stop out.

    A frame that waited for longer than `stale_after` seconds is dropped rather than sent: a set point that
    leaves when someone plugs the cable in again would move a motor that everyone believes idle.
    """

    def __init__(self, *, capacity: int = 256, reserve: int = 64, stale_after: float = 0.25) -> None:
        self._capacity = capacity
        self._reserve = reserve
        self._stale_after = stale_after
        self._urgent: deque[tuple[float, Frame]] = deque()
        self._ordinary: deque[tuple[float, Frame]] = deque()
        self.dropped = 0
        """Frames that were refused, grew stale or were cleared."""

    def __len__(self) -> int:
        return len(self._urgent) + len(self._ordinary)

    @property
    def holds_urgent(self) -> bool:
        """Whether an urgent frame waits."""
        return bool(self._urgent)

    def put(self, frame: Frame, now: float, *, urgent: bool) -> bool:
        """Let a frame wait; False if there is no room for it."""
        queue, room = (self._urgent, self._reserve) if urgent else (self._ordinary, self._capacity)
        if len(queue) >= room:
            self._forget_stale(now)
        if len(queue) >= room:
            self.dropped += 1
            return False
        queue.append((now, frame))
        return True

    def foremost(self, now: float) -> Frame | None:
        """The frame to send next; it stays until `pop`."""
        self._forget_stale(now)
        queue = self._urgent or self._ordinary
        return queue[0][1] if queue else None

    def pop(self) -> None:
        """The foremost frame has left."""
        (self._urgent or self._ordinary).popleft()

    def withdraw(self, cob_ids: Collection[int]) -> int:
        """Drop what waits with one of these identifiers; how many frames that were."""
        withdrawn = 0
        for queue in (self._urgent, self._ordinary):
            kept = [entry for entry in queue if entry[1].cob_id not in cob_ids]
            if len(kept) < len(queue):
                withdrawn += len(queue) - len(kept)
                queue.clear()
                queue.extend(kept)
        return withdrawn

    def clear(self) -> None:
        """Drop all that waits."""
        self.dropped += len(self)
        self._urgent.clear()
        self._ordinary.clear()

    def _forget_stale(self, now: float) -> None:
        for queue in (self._urgent, self._ordinary):
            while queue and now - queue[0][0] > self._stale_after:
                queue.popleft()
                self.dropped += 1
