"""A module's object dictionary as values: `ObjectSpec`, one entry, and `DeviceProfile`, all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.sdo import AbortCode
from drivers.cia301.types import DataType, Value
from drivers.cia402.modes import Mode
from drivers.cia402.power import PowerState
from drivers.devices.emergencies import EmergencyTable
from drivers.devices.layout import AxisLayout, Scope
from drivers.devices.meanings import Meaning, Meanings

__all__ = [
    "Access",
    "AxisLayout",
    "DeviceProfile",
    "Identity",
    "ObjectKind",
    "ObjectSpec",
    "Scope",
    "StoreGroup",
]


class Access(StrEnum):
    """What an SDO may do with an object (CiA 301 §7.4.5)."""

    RO = "ro"
    RW = "rw"
    WO = "wo"
    CONST = "const"

    @property
    def readable(self) -> bool:
        """Whether an upload is allowed."""
        return self is not Access.WO

    @property
    def writable(self) -> bool:
        """Whether a download is allowed."""
        return self in (Access.RW, Access.WO)


class ObjectKind(StrEnum):
    """The object code of CiA 301 §7.4.3."""

    VAR = "var"
    ARRAY = "array"
    RECORD = "record"


class StoreGroup(StrEnum):
    """Which "save" keeps a parameter over a reset."""

    COMMUNICATION = "communication"
    """1010h:2 (and 1010h:1, all)."""
    AXIS = "axis"
    """1010h:4-6, one sub-index per axis (and 1010h:1, all)."""
    MODULE = "module"
    """1010h:1, all, only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSpec:
    """One entry of the object dictionary: what may be read from it, and what may be written when."""

    index: int
    """Index as on the wire, the axis offset included."""
    sub: int
    base_index: int
    """The index of axis 0's copy: the one that the manual prints."""
    name: str
    """Name of the entry (that of the sub-index in a record or array)."""
    object_name: str
    """Name of the whole object; equals `name` for a VAR."""
    kind: ObjectKind
    type: DataType
    access: Access
    scope: Scope
    section: str
    """The section of the module's manual that specifies it."""
    mappable: bool = False
    low: int | None = None
    """Lowest value that may be written; None = that of the type (or no limit, for strings)."""
    high: int | None = None
    """Highest value that may be written; None as for `low`."""
    allowed: Mapping[int, str] | None = None
    """The only values there are, each with its label; None = all from `low` to `high`."""
    default: int | str | None = None
    """Value after "load" and reset. None = none (live values, serial number). See `default_for`."""
    printed_default: int | str | None = None
    """What the manual prints for axis 0 where that is not `default`; `note` says why. None = the same."""
    node_relative: bool = False
    """The node ID is added to `default` and to `printed_default`."""
    unit: str = ""
    """Unit of the number, e.g. ``steps``, ``steps/s``, ``ms``, ``0.1 ms``, ``1/512 s``; empty = none."""
    axis: int | None = None
    writable_in: frozenset[PowerState] | None = None
    """Drive states of the axis in which a write is taken; None = all."""
    stored: StoreGroup | None = None
    """Which "save" keeps it; None = lost at a reset."""
    description: str = ""
    note: str = ""
    """Where the manual is wrong or silent, what was chosen, and whether it is unverified on hardware."""

    @property
    def address(self) -> Address:
        """Index and sub-index on the wire."""
        return Address(self.index, self.sub)

    @property
    def mapped(self) -> MappedObject:
        """The PDO mapping entry. Raises ValueError if the object can't be mapped."""
        if not self.mappable or self.type.bits is None:
            raise ValueError(f"{self.address} {self.name} can't be mapped into a PDO")
        return MappedObject(self.index, self.sub, self.type.bits)

    @property
    def minimum(self) -> int | None:
        """Lowest value by range and type; None for strings."""
        return self.type.minimum if self.low is None and self.type.is_integer else self.low

    @property
    def maximum(self) -> int | None:
        """Highest value by range and type; None for strings."""
        return self.type.maximum if self.high is None and self.type.is_integer else self.high

    def default_for(self, node_id: int) -> int | str | None:
        """The default of a module with this node ID (1..127)."""
        if self.node_relative and isinstance(self.default, int):
            return self.default + node_id
        return self.default

    def check(self, value: Value) -> AbortCode | None:
        """Why the module would refuse `value` by range or list of values; None if it would not.

        06090031h above the range, 06090032h below it, 06090030h inside it but not one of `allowed`.
        Access, length and drive state are not looked at.
        """
        if not isinstance(value, int):
            return None
        if self.maximum is not None and value > self.maximum:
            return AbortCode.VALUE_TOO_HIGH
        if self.minimum is not None and value < self.minimum:
            return AbortCode.VALUE_TOO_LOW
        if self.allowed is not None and value not in self.allowed:
            return AbortCode.INVALID_VALUE
        return None


@dataclass(frozen=True, slots=True)
class Identity:
    """Who made the module and which one it is: what 1000h, 1008h and 1018h answer."""

    vendor_name: str
    vendor_id: int
    product_code: int
    revision_number: int
    """Of the firmware that the data describes; the master does not insist on it."""
    device_type: int
    device_name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceProfile:
    """One model of module: all its objects for all its axes, and what its codes mean."""

    model: str
    identity: Identity
    layout: AxisLayout
    objects: Mapping[Address, ObjectSpec]
    """Every entry of every axis, sub 0 of records and arrays included, ordered by address."""
    emergencies: EmergencyTable
    bit_rates: tuple[int, ...]
    """kbit/s."""
    homing_methods: frozenset[int]
    modes: frozenset[Mode]
    features: frozenset[str]
    """Abilities that the master asks for by name, e.g. ``lss``, ``eight_point_ramp``, ``relative_option``."""
    meanings: Meanings
    manual: str
    """Document and firmware version that the data was taken from."""
    edited: str
    """When the data was last edited, as YYYY-MM-DD."""

    @property
    def vendor_id(self) -> int:
        """1018h:1."""
        return self.identity.vendor_id

    @property
    def product_code(self) -> int:
        """1018h:2."""
        return self.identity.product_code

    @property
    def device_type(self) -> int:
        """1000h."""
        return self.identity.device_type

    @property
    def axes(self) -> int:
        """Number of axes."""
        return self.layout.axes

    def spec(self, index: int, sub: int = 0, axis: int | None = None) -> ObjectSpec:
        """The entry at base index and sub-index of `axis`. Raises KeyError if there is none.

        Without `axis`, `index` is a real index (for axis 0 the two are the same).
        """
        real = index if axis is None else self.layout.index(index, axis)
        return self.objects[Address(real, sub)]

    def find(self, address: Address) -> ObjectSpec | None:
        """The entry at a real address, or None."""
        return self.objects.get(address)

    def bits(self, address: Address) -> tuple[Meaning, ...]:
        """A row for each bit of a flag object that is known, by any axis's address."""
        return self.meanings.bits.get(self._base(address), ())

    def explain_bits(self, address: Address, value: int) -> tuple[Meaning, ...]:
        """What the bits set in `value` of a flag object of any axis mean; unknown bits are left out."""
        return tuple(row for row in self.bits(address) if value >> row.key & 1)

    def explain_code(self, address: Address, value: int) -> Meaning | None:
        """What a value of an option code of any axis means, or None."""
        return next(
            (row for row in self.meanings.codes.get(self._base(address), ()) if row.key == value), None
        )

    def explain_abort(self, code: int) -> Meaning | None:
        """Where an SDO abort comes from on this module, and what to do; None for a code that it has not."""
        return self.meanings.aborts.get(code)

    def abort_remedy(self, code: int) -> str:
        """What to do about an SDO abort on this module; empty for a code that it has not."""
        meaning = self.meanings.aborts.get(code)
        return "" if meaning is None else f"{meaning.cause} {meaning.remedy}"

    def _base(self, address: Address) -> Address:
        return Address(self.layout.locate(address.index)[0], address.sub)
