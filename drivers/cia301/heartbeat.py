"""Heartbeats: their byte, the watch over one producer, and the entries of 1016h (CiA 301 7.2.8.3.2)."""

from __future__ import annotations

from typing import NamedTuple

from drivers.cia301.cob import check_node
from drivers.cia301.nmt import NmtState


def encode(state: NmtState) -> bytes:
    """The one byte of COB-ID 700h + node-ID."""
    return bytes((state,))


def decode(data: bytes) -> NmtState | None:
    """The node's state, or None for anything but one byte that is a state.

    Bit 7, which toggles in node guarding, is not masked: no guarding is ever asked for here.
    """
    if len(data) != 1:
        return None
    try:
        return NmtState(data[0])
    except ValueError:
        return None


class HeartbeatMonitor:
    """Watches one producer. Armed by the first heartbeat that it hears, as 1016h is (manual §3.1.11).

    `now` is seconds on any one monotonic clock. ValueError if `timeout_s` is not positive.
    """

    def __init__(self, timeout_s: float) -> None:
        if not timeout_s > 0:
            raise ValueError(f"a heartbeat time-out of {timeout_s} s watches nothing")
        self.timeout_s = timeout_s
        self._last: float | None = None

    @property
    def armed(self) -> bool:
        """Whether a heartbeat was heard since the start or the last `disarm`."""
        return self._last is not None

    @property
    def deadline(self) -> float | None:
        """When the watch expires unless a heartbeat comes before; None while it is not armed."""
        return None if self._last is None else self._last + self.timeout_s

    def heard(self, now: float) -> None:
        """A heartbeat, or a boot-up, came."""
        self._last = now

    def age(self, now: float) -> float | None:
        """Seconds since the last heartbeat; None while the watch is not armed."""
        return None if self._last is None else now - self._last

    def expired(self, now: float) -> bool:
        """Whether the deadline has come. Stays true until a heartbeat is heard or the watch is disarmed."""
        deadline = self.deadline
        return deadline is not None and now >= deadline

    def disarm(self) -> None:
        """Watch no more until the next heartbeat."""
        self._last = None


class ConsumerEntry(NamedTuple):
    """One sub-index of 1016h: whom to watch, and the longest silence in milliseconds (0: watch nobody)."""

    node: int
    time_ms: int


def consumer_entry(node: int, time_ms: int) -> int:
    """The UNSIGNED32 of 1016h. `node` 1..127, `time_ms` 0..65535; ValueError otherwise."""
    if not 0 <= time_ms <= 0xFFFF:
        raise ValueError(f"a heartbeat time of {time_ms} ms is not in 0..65535")
    return check_node(node) << 16 | time_ms


def decode_consumer_entry(value: int) -> ConsumerEntry:
    """The parts of the UNSIGNED32 of 1016h. The node-ID is not checked: a device may hold any byte."""
    return ConsumerEntry(value >> 16 & 0xFF, value & 0xFFFF)
