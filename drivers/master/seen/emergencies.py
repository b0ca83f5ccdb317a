"""The emergencies of one node: a bounded history, and which of them are still active."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from drivers.cia301.emcy import Emergency
from drivers.devices.emergencies import EmergencyTable, Severity

CAPACITY = 256
"""How many emergencies of one node are kept; a storm pushes out the oldest."""


@dataclass(frozen=True, slots=True)
class EmergencyRecord:
    """One EMCY frame with its meaning (manual §11.2)."""

    id: int
    """Counts up per node."""
    time: datetime
    node: int
    axis: int | None
    """None: the module as a whole."""
    code: int
    register: int
    """1001h"""
    data: bytes
    """The five bytes behind it."""
    title: str
    cause: str
    remedy: str
    severity: Severity
    active: bool
    """Not yet answered by a 0000h for its axis, a fault reset or a boot-up."""


class EmergencyLog:
    """Decodes, explains and keeps a node's emergencies. Bounded, whatever the node sends."""

    def __init__(
        self, node_id: int, table: EmergencyTable, now: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> None:
        self._node_id = node_id
        self._table = table
        self._now = now
        self._count = 0
        self.history: deque[EmergencyRecord] = deque(maxlen=CAPACITY)
        self._active: dict[tuple[int, int | None, int], EmergencyRecord] = {}

    def record(self, emergency: Emergency) -> EmergencyRecord:
        """Take one emergency in; a 0000h clears what is active on its axis."""
        meaning = self._table.explain(emergency)
        self._count += 1
        if emergency.is_reset:
            self.clear(meaning.axis)
        entry = EmergencyRecord(
            id=self._count,
            time=self._now(),
            node=self._node_id,
            axis=meaning.axis,
            code=emergency.code,
            register=emergency.register,
            data=emergency.data,
            title=meaning.title,
            cause=meaning.cause,
            remedy=meaning.remedy,
            severity=meaning.severity,
            active=not emergency.is_reset,
        )
        self.history.append(entry)
        if entry.active:
            key = (entry.code, entry.axis, emergency.data[0])
            self._active.pop(key, None)
            self._active[key] = entry
            while len(self._active) > CAPACITY:
                del self._active[next(iter(self._active))]
        return entry

    def clear(self, axis: int | None) -> None:
        """Nothing is active on `axis` any more; None clears the module's own."""
        for key in [key for key in self._active if key[1] == axis]:
            self._retire(key)

    def clear_all(self) -> None:
        """Nothing is active any more: the module started anew."""
        for key in list(self._active):
            self._retire(key)

    def active(self, axis: int | None = None) -> tuple[EmergencyRecord, ...]:
        """What is active on `axis` and on the module as a whole, oldest first."""
        return tuple(e for e in self._active.values() if e.axis is None or e.axis == axis)

    def all_active(self) -> tuple[EmergencyRecord, ...]:
        """What is active anywhere on the node, oldest first."""
        return tuple(self._active.values())

    def _retire(self, key: tuple[int, int | None, int]) -> None:
        gone = self._active.pop(key)
        for position, entry in enumerate(self.history):
            if entry.id == gone.id:
                self.history[position] = replace(entry, active=False)
                break
