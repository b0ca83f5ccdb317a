"""PDOs: what a mapping packs, how a record is configured, and the writes of a remap in the modules' order."""

from __future__ import annotations

import enum
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from drivers.cia301.cob import MAX_COB_ID, PdoCobId, is_restricted
from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.types import CodecError, DataType

MAX_PDO_BITS: Final = 64
MAX_PDO_NUMBER: Final = 512

_FORMATS: Final = {
    DataType.INTEGER8: "b",
    DataType.INTEGER16: "h",
    DataType.INTEGER32: "i",
    DataType.INTEGER64: "q",
    DataType.UNSIGNED8: "B",
    DataType.UNSIGNED16: "H",
    DataType.UNSIGNED32: "I",
    DataType.UNSIGNED64: "Q",
}


class PdoLengthError(ValueError):
    """A PDO carries fewer or more bytes than are mapped."""


@dataclass(frozen=True, slots=True)
class PdoMapping:
    """The objects that one PDO carries, first byte first, each with its type.

    Integer types only. ValueError if types and entries differ in number or length, or pass 64 bits together.
    """

    entries: tuple[MappedObject, ...]
    types: tuple[DataType, ...]
    _packing: struct.Struct = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.entries) != len(self.types):
            raise ValueError(f"{len(self.entries)} entries but {len(self.types)} types")
        for entry, data_type in zip(self.entries, self.types, strict=True):
            if data_type not in _FORMATS:
                raise ValueError(f"{entry}: {data_type.name} can't be mapped here")
            if entry.bits != data_type.bits:
                raise ValueError(f"{entry}: a {data_type.name} has {data_type.bits} bits")
        if self.bits > MAX_PDO_BITS:
            raise ValueError(f"{self.bits} bits are mapped, but a PDO carries {MAX_PDO_BITS}")
        packing = struct.Struct("<" + "".join(_FORMATS[data_type] for data_type in self.types))
        object.__setattr__(self, "_packing", packing)

    @property
    def bits(self) -> int:
        """Length in bits."""
        return sum(entry.bits for entry in self.entries)

    @property
    def size(self) -> int:
        """Length in bytes."""
        return self.bits // 8

    def pack(self, values: Sequence[int]) -> bytes:
        """The PDO's bytes, exactly `size`. CodecError for a wrong number of values or one out of range."""
        try:
            return self._packing.pack(*values)
        except struct.error as error:
            names = ", ".join(
                f"{entry.address} {t.short}" for entry, t in zip(self.entries, self.types, strict=True)
            )
            raise CodecError(f"{tuple(values)} does not fit {names or 'an empty PDO'}: {error}") from error

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """The values in `data`. PdoLengthError unless it has exactly `size` bytes.

        CiA 301 lets a receiver take the beginning of a longer one. But a length that isn't mapped means that
        somebody else sends under this identifier, or that the sender holds another mapping: its bytes mean
        something else.
        """
        try:
            return self._packing.unpack(data)
        except struct.error:
            raise PdoLengthError(f"{len(data)} bytes came where {self._packing.size} are mapped") from None


class TransmissionType:
    """Values of sub-index 2 that the modules know (manual §3.1.15, §3.1.17)."""

    EVERY_SYNC: Final = 1
    """n = 1..240: at each n-th SYNC."""
    SYNC_MAX: Final = 240
    EVENT_MANUFACTURER: Final = 0xFE
    EVENT_PROFILE: Final = 0xFF


def is_synchronous(transmission_type: int) -> bool:
    """Whether the PDO goes with each n-th SYNC (1..240)."""
    return TransmissionType.EVERY_SYNC <= transmission_type <= TransmissionType.SYNC_MAX


def is_event_driven(transmission_type: int) -> bool:
    """Whether the PDO goes on a change or a timer (FEh, FFh)."""
    return transmission_type in (TransmissionType.EVENT_MANUFACTURER, TransmissionType.EVENT_PROFILE)


class Direction(enum.Enum):
    """As the node sees it: it RECEIVEs what commands it, and TRANSMITs its status."""

    RECEIVE = "receive"
    TRANSMIT = "transmit"


_COMMUNICATION: Final = {Direction.RECEIVE: 0x1400, Direction.TRANSMIT: 0x1800}
_MAPPING_OFFSET: Final = 0x200


def pdo_communication_index(direction: Direction, number: int) -> int:
    """Index of the communication record of PDO `number`, 1..512; ValueError otherwise."""
    if not 1 <= number <= MAX_PDO_NUMBER:
        raise ValueError(f"PDO {number} is not in 1..{MAX_PDO_NUMBER}")
    return _COMMUNICATION[direction] + number - 1


def pdo_mapping_index(direction: Direction, number: int) -> int:
    """Index of the mapping record of PDO `number`, 1..512; ValueError otherwise."""
    return pdo_communication_index(direction, number) + _MAPPING_OFFSET


@dataclass(frozen=True, slots=True)
class PdoConfiguration:
    """All that one PDO of a node is to be. ValueError for a COB-ID that no enabled PDO may have."""

    direction: Direction
    number: int
    """1..512; for the modules 1-4, 65-68 and 129-132 (manual §3.1.15)."""
    cob_id: int
    """11 bits."""
    mapping: PdoMapping
    transmission_type: int
    inhibit_time_100us: int | None = None
    """Units of 0.1 ms, 0 for none; None leaves the object alone. TPDOs only, on the modules."""
    event_timer_ms: int | None = None
    """Milliseconds, 0 for none; None leaves the object alone. TPDOs only, on the modules."""
    enabled: bool = True

    def __post_init__(self) -> None:
        pdo_communication_index(self.direction, self.number)
        if not 0 <= self.cob_id <= MAX_COB_ID or (self.enabled and is_restricted(self.cob_id)):
            raise ValueError(f"COB-ID {self.cob_id:X}h can't be a PDO's")


class WriteStep(NamedTuple):
    """One object to write."""

    address: Address
    data_type: DataType
    value: int


def remap_steps(configuration: PdoConfiguration) -> tuple[WriteStep, ...]:
    """The writes that bring a PDO from any state to `configuration`, in the order of manual §3.1.16.

    Deactivate (bit 31), no entries, the entries, their number, the rest of the record, activate. Of a PDO
    that is not enabled only the first remains.
    """
    communication = pdo_communication_index(configuration.direction, configuration.number)
    mapping = pdo_mapping_index(configuration.direction, configuration.number)

    def cob_id(*, valid: bool) -> WriteStep:
        entry = PdoCobId(configuration.cob_id, valid=valid).encode()
        return WriteStep(Address(communication, 1), DataType.UNSIGNED32, entry)

    if not configuration.enabled:
        return (cob_id(valid=False),)
    entries = configuration.mapping.entries
    timers = ((3, configuration.inhibit_time_100us), (5, configuration.event_timer_ms))
    return (
        cob_id(valid=False),
        WriteStep(Address(mapping, 0), DataType.UNSIGNED8, 0),
        *(
            WriteStep(Address(mapping, sub), DataType.UNSIGNED32, entry.encode())
            for sub, entry in enumerate(entries, start=1)
        ),
        WriteStep(Address(mapping, 0), DataType.UNSIGNED8, len(entries)),
        WriteStep(Address(communication, 2), DataType.UNSIGNED8, configuration.transmission_type),
        *(
            WriteStep(Address(communication, sub), DataType.UNSIGNED16, value)
            for sub, value in timers
            if value is not None
        ),
        cob_id(valid=True),
    )
