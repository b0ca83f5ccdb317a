"""The object dictionary of a simulated module: every object's value, every check that a write must pass."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from drivers.cia301.objects import Address
from drivers.cia301.sdo import AbortCode, SdoAbort
from drivers.cia301.types import CodecError, DataType, Value, decode, encode
from drivers.devices.profile import DeviceProfile, ObjectSpec, Scope
from drivers.sim.interface import AxisUnit


class Watcher(Protocol):
    """Whoever looks after some objects besides the dictionary: PDO records, heartbeats, store commands."""

    def veto(self, address: Address, value: int, now: float) -> AbortCode | None:
        """Why `value` can't be written now, though type and access allow it; None = it can.

        Asked before range and list of values are, so that it may refuse with a more telling code.
        """
        ...

    def written(self, address: Address, value: int, now: float) -> None:
        """The object holds `value` now. May raise `SdoAbort`; the old value is then put back."""
        ...


Live = Callable[[], int]
"""Gives the value of an object that is computed when it is read."""


class ObjectDictionary:
    """Values by address, as SDO and PDO see them.

    Attach the axes and the watchers before use. No method looks at the NMT state.
    """

    def __init__(self, profile: DeviceProfile) -> None:
        self.profile = profile
        self._values: dict[Address, Value] = {}
        self._indices = frozenset(address.index for address in profile.objects)
        self._axes: Sequence[AxisUnit] = ()
        self._live: dict[Address, Live] = {}
        self._watchers: dict[int, Watcher] = {}

    # --- wiring ---------------------------------------------------------------------------------------------

    def attach_axes(self, axes: Sequence[AxisUnit]) -> None:
        """Route reads and writes of axis objects to these axes, in the order of their numbers."""
        self._axes = axes

    def attach_live(self, address: Address, live: Live) -> None:
        """Compute the object's value whenever it is read."""
        self._live[address] = live

    def watch(self, indices: Iterable[int], watcher: Watcher) -> None:
        """Have `watcher` see the writes to all sub-indices of these objects."""
        for index in indices:
            self._watchers[index] = watcher

    # --- values ---------------------------------------------------------------------------------------------

    def load(self, values: Mapping[Address, Value]) -> None:
        """Replace values without a check; nobody is told."""
        self._values.update(values)

    def stored(self, address: Address) -> int:
        """The stored number, whether or not the object is live. Raises KeyError if there is none."""
        value = self._values[address]
        if isinstance(value, int):
            return value
        raise KeyError(address)

    def store(self, address: Address, value: int) -> None:
        """Change a stored number without a check; nobody is told. Raises KeyError if there is none."""
        if address not in self._values:
            raise KeyError(address)
        self._values[address] = value

    def value(self, spec: ObjectSpec, now: float) -> Value:
        """What a read gives now."""
        axis = self._axis_of(spec)
        if axis is not None:
            live = axis.read(spec.base_index, spec.sub, now)
            if live is not None:
                return live
        computed = self._live.get(spec.address)
        return self._values[spec.address] if computed is None else computed()

    # --- access ---------------------------------------------------------------------------------------------

    def find(self, address: Address) -> ObjectSpec:
        """The entry at an address. Raises `SdoAbort` 06020000h (no such object), 06090011h (no such sub)."""
        spec = self.profile.find(address)
        if spec is None:
            raise SdoAbort(
                AbortCode.NO_SUCH_SUB_INDEX if address.index in self._indices else AbortCode.NO_SUCH_OBJECT
            )
        return spec

    def size_of(self, address: Address) -> int | None:
        """Bytes that the object takes; None for strings and for what does not exist."""
        spec = self.profile.find(address)
        return None if spec is None else spec.type.size

    def read(self, address: Address, now: float) -> bytes:
        """What an SDO upload gives. Raises `SdoAbort`."""
        spec = self.find(address)
        if not spec.access.readable:
            raise SdoAbort(AbortCode.WRITE_ONLY)
        return encode(spec.type, self.value(spec, now))

    def write(self, address: Address, data: bytes, now: float) -> None:
        """What an SDO download does, with every check of the manual. Raises `SdoAbort`."""
        spec = self.find(address)
        if not spec.access.writable:
            raise SdoAbort(AbortCode.READ_ONLY)
        size = spec.type.size
        if size is not None and len(data) != size:
            raise SdoAbort(AbortCode.LENGTH_TOO_HIGH if len(data) > size else AbortCode.LENGTH_TOO_LOW)
        value = decode_number(spec.type, data)
        refusal = self.refusal(spec, value, now)
        if refusal is not None:
            raise SdoAbort(refusal)
        self.assign(spec, value, now)

    def refusal(self, spec: ObjectSpec, value: int, now: float) -> AbortCode | None:
        """Why a value of the right length would not be taken now; None = it would."""
        watcher = self._watchers.get(spec.index)
        if watcher is not None:
            refusal = watcher.veto(spec.address, value, now)
            if refusal is not None:
                return refusal
        refusal = spec.check(value)
        axis = self._axis_of(spec)
        if refusal is not None or axis is None:
            return refusal
        if spec.writable_in is not None and axis.state not in spec.writable_in:
            return AbortCode.DEVICE_STATE
        return axis.may_write(spec.base_index, spec.sub, value, now)

    def assign(self, spec: ObjectSpec, value: int, now: float) -> None:
        """Store a value that passed `refusal`; tell who acts on it. Raises `SdoAbort` if that one can't."""
        address = spec.address
        before = self._values[address]
        self._values[address] = value
        try:
            axis = self._axis_of(spec)
            if axis is not None:
                axis.written(spec.base_index, spec.sub, value, now)
            watcher = self._watchers.get(spec.index)
            if watcher is not None:
                watcher.written(address, value, now)
        except SdoAbort:
            self._values[address] = before
            raise

    def _axis_of(self, spec: ObjectSpec) -> AxisUnit | None:
        """The axis that acts on an object. PDO records belong to an axis too, but not to its drive."""
        if spec.scope is not Scope.AXIS or spec.axis is None or not self._axes:
            return None
        return self._axes[spec.axis]


class AxisView:
    """The stored objects of one axis by their base indices: `AxisParameters` for `SimulatedAxis`."""

    def __init__(self, dictionary: ObjectDictionary, axis: int) -> None:
        self._dictionary = dictionary
        self._addresses = {
            (spec.base_index, spec.sub): address
            for address, spec in dictionary.profile.objects.items()
            if spec.axis in (axis, None)
        }

    def get(self, base_index: int, sub: int = 0) -> int:
        """See `AxisParameters.get`."""
        return self._dictionary.stored(self._addresses[base_index, sub])

    def set(self, base_index: int, sub: int, value: int) -> None:
        """See `AxisParameters.set`."""
        self._dictionary.store(self._addresses[base_index, sub], value)


def decode_number(data_type: DataType, data: bytes) -> int:
    """A number from the wire. Raises `SdoAbort` 06070010h for what is none: no string is writable."""
    try:
        value = decode(data_type, data)
    except CodecError:
        raise SdoAbort(AbortCode.LENGTH_MISMATCH) from None
    if not isinstance(value, int):
        raise SdoAbort(AbortCode.LENGTH_MISMATCH)
    return value


def defaults(profile: DeviceProfile, node_id: int) -> dict[Address, Value]:
    """The value of every object after "load" and a reset; what has no default begins as 0 or empty."""
    values: dict[Address, Value] = {}
    for address, spec in profile.objects.items():
        default = spec.default_for(node_id)
        values[address] = (0 if spec.type.is_integer else "") if default is None else default
    return values
