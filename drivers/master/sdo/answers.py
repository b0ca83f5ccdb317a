"""Two modules under one node ID: both answer each SDO request, so every transfer leaves an answer over.

A second master leaves answers over too, but there its requests are heard before them.
"""

from __future__ import annotations

from drivers.master.ground.counters import SdoCounters

DOUBLED = 6
"""So many transfers in a row, each answered more than once, are no accident of the wire."""


class AnswerWatch:
    """Looks at one node's SDO counters after each answer."""

    def __init__(self, counters: SdoCounters) -> None:
        self._counters = counters
        self._surplus = self._counted
        self._ended = self._transfers
        self.doubled = 0
        """How many transfers in a row were answered more than once."""

    @property
    def suspicious(self) -> bool:
        """Whether the last transfers had answers too many; a few more will tell."""
        return self.doubled >= DOUBLED // 2

    @property
    def duplicate(self) -> bool:
        """Whether two modules answer."""
        return self.doubled >= DOUBLED

    def look(self) -> None:
        """An answer was handled."""
        if self._surplus == self._counted:
            if self._transfers > self._ended + 1:
                self.doubled = 0  # a transfer ended since, and one before it, with nothing left over
            return
        self._surplus = self._counted
        if self._transfers > self._ended:
            self.doubled = self.doubled + 1 if self._transfers == self._ended + 1 else 1
            self._ended = self._transfers

    def forget(self) -> None:
        """The node started anew, is looked for again, or was asked by another master and answers that one."""
        self._surplus, self._ended, self.doubled = self._counted, self._transfers, 0

    @property
    def _counted(self) -> int:
        """Answers that nobody had asked for."""
        return self._counters.late + self._counters.foreign

    @property
    def _transfers(self) -> int:
        """Transfers that the node answered, one way or another."""
        return self._counters.completed + self._counters.aborted_by_node
