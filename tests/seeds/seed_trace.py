"""What happened in a run: the last lines to read, and a hash over all of them."""

from __future__ import annotations

import asyncio
import hashlib
from collections import deque

from drivers.bus.frame import Frame

KEPT = 160
"""Lines that are kept for people."""


class Trace:
    """Every command, fault, frame and change of state goes through here, in order."""

    def __init__(self, kept: int = KEPT) -> None:
        self._lines: deque[str] = deque(maxlen=kept)
        self._hash = hashlib.blake2b(digest_size=16)
        self._loop = asyncio.get_running_loop()
        self._said: dict[int, bytes] = {}
        self.count = 0

    def note(self, source: str, text: str) -> None:
        """Add a line."""
        self._lines.append(self._count(source, text))

    def frame(self, sender: str, frame: Frame) -> None:
        """Add a frame; what only says again what its identifier said last is counted, but not shown."""
        line = self._count(sender or "noise", str(frame))
        cyclic = frame.cob_id >> 7 & 1 or frame.cob_id > 0x700
        if not cyclic or self._said.get(frame.cob_id) != frame.data:
            self._lines.append(line)
        self._said[frame.cob_id] = frame.data

    def _count(self, source: str, text: str) -> str:
        line = f"{self._loop.time():11.6f} {source:<10} {text}"
        self._hash.update(line.encode())
        self.count += 1
        return line

    @property
    def digest(self) -> str:
        """Of everything so far; two runs of one seed have the same."""
        return self._hash.hexdigest()

    def __str__(self) -> str:
        return "\n".join(self._lines)
