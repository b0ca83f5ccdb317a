"""The PDO parameter records 1400h-1BFFh: what they say, and the rules for changing them (§3.1.15-3.1.18).

Where the manual is silent on the abort code, unverified on hardware: what must not change while the PDO is
active is refused with 06010000h; an identifier that no PDO may have, and a clear bit 30, with 06090030h.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from drivers.cia301.cob import PdoCobId, is_restricted
from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.pdo import Direction, PdoMapping, pdo_communication_index, pdo_mapping_index
from drivers.cia301.sdo import AbortCode
from drivers.devices.profile import ObjectSpec
from drivers.sim.dictionary import ObjectDictionary

MAX_ENTRIES: Final = 3
MAX_BITS: Final = 64
PDOS_PER_AXIS: Final = 4

COB_ID: Final = 1
TRANSMISSION_TYPE: Final = 2
INHIBIT_TIME: Final = 3
EVENT_TIMER: Final = 5

_FIXED_BITS: Final = 0x3FFFF800
"""Bits 11-29 of a COB-ID: 11-bit identifiers only."""


@dataclass(frozen=True, slots=True)
class PdoSetup:
    """What the two records of one PDO say now."""

    cob_id: int
    active: bool
    transmission_type: int
    inhibit: float
    """Seconds; 0 = none."""
    event_timer: float
    """Seconds; 0 = none."""
    specs: tuple[ObjectSpec, ...]
    mapping: PdoMapping


@dataclass(frozen=True, slots=True)
class PdoRecord:
    """Where the two records of one PDO lie."""

    direction: Direction
    number: int
    communication: int
    mapping: int


Changed = Callable[[PdoRecord], None]


class PdoRecords:
    """All PDO records of the module; a `Watcher` of the dictionary that keeps the rules of a remap."""

    def __init__(self, dictionary: ObjectDictionary, changed: Changed) -> None:
        """`changed` is called after each write to a record."""
        self._dictionary = dictionary
        self._changed = changed
        layout = dictionary.profile.layout
        self.records = tuple(
            PdoRecord(
                direction,
                number,
                pdo_communication_index(direction, number),
                pdo_mapping_index(direction, number),
            )
            for direction in Direction
            for axis in range(layout.axes)
            for number in (layout.pdo_number(own, axis) for own in range(1, PDOS_PER_AXIS + 1))
        )
        self._by_index = {record.communication: record for record in self.records}
        self._by_index |= {record.mapping: record for record in self.records}
        dictionary.watch(self._by_index, self)

    def setup(self, record: PdoRecord) -> PdoSetup:
        """What the record says now."""
        cob_id = PdoCobId.decode(self._get(record.communication, COB_ID))
        transmits = record.direction is Direction.TRANSMIT
        specs = self._mapped(record)
        return PdoSetup(
            cob_id.cob_id,
            cob_id.valid,
            self._get(record.communication, TRANSMISSION_TYPE),
            self._get(record.communication, INHIBIT_TIME) / 10_000 if transmits else 0.0,
            self._get(record.communication, EVENT_TIMER) / 1000 if transmits else 0.0,
            specs,
            PdoMapping(tuple(spec.mapped for spec in specs), tuple(spec.type for spec in specs)),
        )

    # --- Watcher --------------------------------------------------------------------------------------------

    def veto(self, address: Address, value: int, now: float) -> AbortCode | None:  # noqa: ARG002
        """See `Watcher.veto`."""
        record = self._by_index[address.index]
        active = PdoCobId.decode(self._get(record.communication, COB_ID)).valid
        if address.index == record.communication:
            if address.sub == COB_ID:
                return self._veto_cob_id(record, value, active=active)
            # CiA 301 §7.5.2.37 fixes the inhibit time of an active PDO; type and event timer may change.
            return AbortCode.UNSUPPORTED_ACCESS if active and address.sub == INHIBIT_TIME else None
        if active:
            return AbortCode.UNSUPPORTED_ACCESS
        return self._veto_count(record, value) if address.sub == 0 else self._veto_entry(record, value)

    def written(self, address: Address, value: int, now: float) -> None:  # noqa: ARG002
        """See `Watcher.written`."""
        self._changed(self._by_index[address.index])

    # --- rules ----------------------------------------------------------------------------------------------

    def _veto_cob_id(self, record: PdoRecord, value: int, *, active: bool) -> AbortCode | None:
        new = PdoCobId.decode(value)
        if new.rtr_allowed or value & _FIXED_BITS:
            return AbortCode.INVALID_VALUE
        if not new.valid:
            return None
        if active and new.cob_id != PdoCobId.decode(self._get(record.communication, COB_ID)).cob_id:
            return AbortCode.UNSUPPORTED_ACCESS
        return AbortCode.INVALID_VALUE if is_restricted(new.cob_id) else None

    def _veto_count(self, record: PdoRecord, count: int) -> AbortCode | None:
        if count > MAX_ENTRIES:
            return AbortCode.PDO_LENGTH_EXCEEDED
        bits = 0
        for sub in range(1, count + 1):
            entry = self._get(record.mapping, sub)
            if entry == 0:
                return AbortCode.NOT_MAPPABLE
            bits += MappedObject.decode(entry).bits
        return AbortCode.PDO_LENGTH_EXCEEDED if bits > MAX_BITS else None

    def _veto_entry(self, record: PdoRecord, value: int) -> AbortCode | None:
        if self._get(record.mapping, 0) != 0:
            return AbortCode.UNSUPPORTED_ACCESS
        if value == 0:
            return None
        entry = MappedObject.decode(value)
        spec = self._dictionary.profile.find(entry.address)
        if spec is None:
            return AbortCode.NO_SUCH_OBJECT
        access = spec.access
        usable = access.writable if record.direction is Direction.RECEIVE else access.readable
        if not (spec.mappable and usable and entry.bits == spec.type.bits):
            return AbortCode.NOT_MAPPABLE
        return None

    # --- inside ---------------------------------------------------------------------------------------------

    def _mapped(self, record: PdoRecord) -> tuple[ObjectSpec, ...]:
        entries = (
            MappedObject.decode(self._get(record.mapping, sub))
            for sub in range(1, self._get(record.mapping, 0) + 1)
        )
        return tuple(self._dictionary.find(entry.address) for entry in entries)

    def _get(self, index: int, sub: int) -> int:
        return self._dictionary.stored(Address(index, sub))
