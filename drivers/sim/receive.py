"""Receive PDOs: taken at once or at each n-th SYNC, all of a PDO or nothing of it (manual §3.1.15, §11.2)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from drivers.cia301.pdo import Direction, is_synchronous
from drivers.cia301.sdo import SdoAbort
from drivers.cia402.objects import CONTROLWORD
from drivers.sim.dictionary import ObjectDictionary
from drivers.sim.pdo_records import PdoRecord, PdoRecords, PdoSetup

TOO_SHORT: Final = 0x8210
TOO_LONG: Final = 0x8220
NOT_ACCEPTED: Final = 0x6320


class ReceivePdo:
    """One RPDO with what it remembers: the data that waits for its SYNC, how many have passed."""

    def __init__(self, setup: PdoSetup) -> None:
        self.setup = setup
        self._waiting: bytes | None = None
        self._syncs = 0

    def take(self, data: bytes) -> bytes | None:
        """The data to apply at once; None if it waits for a SYNC."""
        if not is_synchronous(self.setup.transmission_type):
            return data
        self._waiting = data
        return None

    def sync(self) -> bytes | None:
        """The data to apply at this SYNC, if any waits and it is the n-th."""
        if not is_synchronous(self.setup.transmission_type):
            return None
        self._syncs += 1
        if self._syncs < self.setup.transmission_type:
            return None
        self._syncs = 0
        data, self._waiting = self._waiting, None
        return data


class ReceivePdos:
    """All RPDOs of the module. Deaf unless started."""

    def __init__(self, dictionary: ObjectDictionary, complain: Callable[[int], None]) -> None:
        """`complain` is given the EMCY code of a PDO that could not be taken."""
        self._dictionary = dictionary
        self._complain = complain
        self._pdos: dict[int, ReceivePdo] = {}
        self._by_cob_id: dict[int, list[ReceivePdo]] = {}
        self._running = False

    def configure(self, records: PdoRecords, record: PdoRecord) -> None:
        """A record changed: take it over; data that waited for a SYNC is forgotten."""
        if not self._running:
            return
        self._pdos[record.number] = ReceivePdo(records.setup(record))
        self._by_cob_id = {}
        for pdo in self._pdos.values():
            if pdo.setup.active and pdo.setup.specs:
                self._by_cob_id.setdefault(pdo.setup.cob_id, []).append(pdo)

    def start(self, records: PdoRecords) -> None:
        """NMT Operational was entered; SYNCs are counted from here."""
        self._running = True
        for record in records.records:
            if record.direction is Direction.RECEIVE:
                self.configure(records, record)

    def stop(self) -> None:
        """NMT Operational was left."""
        self._running = False

    def listens(self, cob_id: int) -> bool:
        """Whether a frame with this identifier is a PDO for this module now."""
        return self._running and cob_id in self._by_cob_id

    def receive(self, cob_id: int, data: bytes, now: float) -> None:
        """A frame that `listens` said yes to."""
        for pdo in self._by_cob_id[cob_id]:
            if len(data) != pdo.setup.mapping.size:
                self._complain(TOO_SHORT if len(data) < pdo.setup.mapping.size else TOO_LONG)
                continue
            ready = pdo.take(data)
            if ready is not None:
                self._apply(pdo.setup, ready, now)

    def sync(self, now: float) -> None:
        """Apply what waited for this SYNC."""
        if self._running:
            for pdo in self._pdos.values():
                data = pdo.sync()
                if data is not None:
                    self._apply(pdo.setup, data, now)

    def _apply(self, setup: PdoSetup, data: bytes, now: float) -> None:
        values = list(zip(setup.specs, setup.mapping.unpack(data), strict=True))
        if any(self._dictionary.refusal(spec, value, now) is not None for spec, value in values):
            self._complain(NOT_ACCEPTED)
            return
        # The default RPDOs carry the controlword before what it starts: it is acted on last. Unverified on
        # hardware.
        values.sort(key=lambda pair: pair[0].base_index == CONTROLWORD)
        try:
            for spec, value in values:
                self._dictionary.assign(spec, value, now)
        except SdoAbort:
            self._complain(NOT_ACCEPTED)
