"""Transmit PDOs: on a change, on the event timer, at each n-th SYNC (manual §3.1.17)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from drivers.bus.frame import Frame
from drivers.cia301.pdo import Direction, is_event_driven, is_synchronous
from drivers.cia402.objects import POSITION, POSITION_DEMAND, POSITION_INTERNAL, VELOCITY
from drivers.sim.dictionary import ObjectDictionary
from drivers.sim.interface import AxisUnit
from drivers.sim.pdo_records import PdoRecord, PdoRecords, PdoSetup

SAMPLING: Final = 0.001
"""Seconds between two looks at a value that changes all the time, where no longer inhibit time is set."""

_CONTINUOUS: Final = frozenset((POSITION_DEMAND, POSITION_INTERNAL, POSITION, VELOCITY))
"""Objects that change all the time while an axis moves; all others change at the axis's events only."""


class TransmitPdo:
    """One TPDO with what it remembers: the last bytes, when they were sent, how many SYNCs have passed."""

    def __init__(self, setup: PdoSetup, read: Callable[[PdoSetup], bytes]) -> None:
        self.setup = setup
        self._read = read
        self._sent: bytes | None = None
        self._sent_at = float("-inf")
        self._looked_at = float("-inf")
        self._waiting = False
        self._syncs = 0
        self.followed = frozenset(
            spec.axis for spec in setup.specs if spec.axis is not None and spec.base_index in _CONTINUOUS
        )
        """Axes whose motion changes this PDO all the time."""
        self._interval = max(setup.inhibit, SAMPLING) if self.followed else setup.inhibit

    @property
    def usable(self) -> bool:
        """Whether there is anything to send."""
        return self.setup.active and bool(self.setup.specs)

    def poll(self, now: float) -> Frame | None:
        """The PDO, if a change or the event timer asks for it and the inhibit time is over."""
        if not (self.usable and is_event_driven(self.setup.transmission_type)):
            return None
        self._waiting = now < self._ready
        if self._waiting:
            return None  # there may be a change; that is looked at when it may be sent
        self._looked_at = now
        data = self._read(self.setup)
        timer = self._timer
        wanted = data != self._sent or (timer is not None and now >= timer)
        return self._send(data, now) if wanted else None

    def sync(self, now: float) -> Frame | None:
        """The PDO, if this is its n-th SYNC."""
        if not (self.usable and is_synchronous(self.setup.transmission_type)):
            return None
        self._syncs += 1
        if self._syncs < self.setup.transmission_type:
            return None
        self._syncs = 0
        return self._send(self._read(self.setup), now)

    def wakeup(self, moving: bool) -> float | None:
        """When `poll` may have something to send though nothing happens in between; None = never."""
        if not (self.usable and is_event_driven(self.setup.transmission_type)):
            return None
        due = self._timer
        if self._waiting or moving:
            # What was just looked at and had not changed is looked at again later, not in the same moment.
            look = self._ready if self._waiting else max(self._ready, self._looked_at + SAMPLING)
            due = look if due is None else min(due, look)
        return due if due is None else max(due, self._ready)

    @property
    def _ready(self) -> float:
        return self._sent_at + self._interval

    @property
    def _timer(self) -> float | None:
        return self._sent_at + self.setup.event_timer if self.setup.event_timer else None

    def _send(self, data: bytes, now: float) -> Frame:
        self._sent, self._sent_at, self._waiting = data, now, False
        return Frame(self.setup.cob_id, data)


class TransmitPdos:
    """All TPDOs of the module. Silent unless started."""

    def __init__(self, dictionary: ObjectDictionary, axes: Callable[[], Iterable[AxisUnit]]) -> None:
        self._dictionary = dictionary
        self._axes = axes
        self._pdos: dict[int, TransmitPdo] = {}
        self._running = False
        self._now = 0.0

    def configure(self, records: PdoRecords, record: PdoRecord) -> None:
        """A record changed: take it over. The PDO is then sent as if it were new. Unverified on hardware."""
        if self._running:
            self._pdos[record.number] = TransmitPdo(records.setup(record), self._read)

    def start(self, records: PdoRecords) -> None:
        """NMT Operational was entered: each event-driven PDO is sent once, SYNCs are counted from here."""
        self._running = True
        for record in records.records:
            if record.direction is Direction.TRANSMIT:
                self.configure(records, record)

    def stop(self) -> None:
        """NMT Operational was left."""
        self._running = False

    def poll(self, now: float) -> list[Frame]:
        """What changes and event timers ask for now."""
        return self._collect(TransmitPdo.poll, now)

    def sync(self, now: float) -> list[Frame]:
        """What this SYNC asks for."""
        return self._collect(TransmitPdo.sync, now)

    def next_wakeup(self) -> float | None:
        """When `poll` must be called next; None = only when something happens."""
        if not self._running:
            return None
        moving = {number for number, axis in enumerate(self._axes()) if axis.moving}
        due = (pdo.wakeup(not pdo.followed.isdisjoint(moving)) for pdo in self._pdos.values())
        return min((time for time in due if time is not None), default=None)

    def _collect(self, ask: Callable[[TransmitPdo, float], Frame | None], now: float) -> list[Frame]:
        if not self._running:
            return []
        self._now = now
        frames = (ask(pdo, now) for pdo in self._pdos.values())
        return [frame for frame in frames if frame is not None]

    def _read(self, setup: PdoSetup) -> bytes:
        values = (self._dictionary.value(spec, self._now) for spec in setup.specs)
        return setup.mapping.pack([value for value in values if isinstance(value, int)])
