"""Heartbeats: the module's own (1017h), and the watch over another node's (1016h)."""

from __future__ import annotations

import enum

from drivers.cia301.heartbeat import HeartbeatMonitor, decode_consumer_entry
from drivers.cia301.sdo import AbortCode


class ErrorBehavior(enum.Enum):
    """What the values of 1029h mean: the manual (§3.1.14) and CiA 301 differ. Unverified on hardware."""

    MANUAL = "manual"
    """0 = Stopped, 1 = remain, and CiA's 2 = Stopped is understood; all others are taken and mean remain."""
    MANUAL_ONLY = "manual only"
    """0 = Stopped, 1 = remain; all other values are refused with 06090030h."""
    CIA_301 = "CiA 301"
    """0 = Pre-operational, 1 = remain, 2 = Stopped; all other values are refused with 06090030h."""

    def veto(self, value: int) -> AbortCode | None:
        """Why 1029h does not take a value; None = it does."""
        highest = {ErrorBehavior.MANUAL: 0xFF, ErrorBehavior.MANUAL_ONLY: 1, ErrorBehavior.CIA_301: 2}[self]
        return AbortCode.INVALID_VALUE if value > highest else None

    def reaction(self, value: int) -> Reaction:
        """What the module does on an error of the class."""
        if value == 2 or (value == 0 and self is not ErrorBehavior.CIA_301):
            return Reaction.STOP
        return Reaction.PRE_OPERATIONAL if value == 0 else Reaction.REMAIN


class Reaction(enum.Enum):
    """What an error does to the NMT state."""

    REMAIN = "remain"
    PRE_OPERATIONAL = "enter Pre-operational"
    STOP = "enter Stopped"


class HeartbeatProducer:
    """When the module's heartbeat is due."""

    def __init__(self) -> None:
        self._period = 0.0
        self._due: float | None = None

    def configure(self, time_ms: int, now: float) -> None:
        """1017h holds a new time: the first heartbeat is due at once, 0 ends them (CiA 301 §7.2.8.3.2.2)."""
        self._period = time_ms / 1000
        self._due = now if time_ms else None

    @property
    def next_wakeup(self) -> float | None:
        """When it is due next."""
        return self._due

    def poll(self, now: float) -> bool:
        """Whether it is due now; the next one is then set. What was missed meanwhile is not made up for."""
        if self._due is None or now < self._due:
            return False
        self._due = self._due + self._period
        if self._due <= now:
            self._due = now + self._period
        return True


class HeartbeatConsumer:
    """The watch that 1016h:1 sets; armed by the first heartbeat heard (manual §3.1.11)."""

    def __init__(self) -> None:
        self.node: int | None = None
        """Whom it watches; None = nobody."""
        self.heard_at: float | None = None
        """When the last heartbeat of the watched node came."""
        self.lost_at: float | None = None
        """When it was found missing; None unless it is missing still."""
        self._monitor: HeartbeatMonitor | None = None

    def configure(self, entry: int) -> None:
        """1016h:1 holds a new value: the watch begins anew, unarmed."""
        consumer = decode_consumer_entry(entry)
        watching = consumer.time_ms > 0 and 1 <= consumer.node <= 127
        self.node = consumer.node if watching else None
        self._monitor = HeartbeatMonitor(consumer.time_ms / 1000) if watching else None
        self.heard_at = self.lost_at = None

    def heard(self, now: float) -> bool:
        """A heartbeat of the watched node came; whether that ends a failure."""
        if self._monitor is None:
            return False
        self._monitor.heard(now)
        recovered = self.lost_at is not None
        self.heard_at, self.lost_at = now, None
        return recovered

    @property
    def next_wakeup(self) -> float | None:
        """When the watch expires."""
        return None if self._monitor is None else self._monitor.deadline

    def poll(self, now: float) -> bool:
        """Whether the heartbeat was found lost just now; the watch then waits for the next heartbeat."""
        if self._monitor is None or not self._monitor.expired(now):
            return False
        self._monitor.disarm()
        self.lost_at = now
        return True
