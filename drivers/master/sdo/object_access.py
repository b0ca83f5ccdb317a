"""Objects of one node as values rather than bytes, typed by the module's profile."""

from __future__ import annotations

from drivers.cia301.objects import Address
from drivers.cia301.types import CodecError, DataType, Value, decode, encode
from drivers.devices.profile import DeviceProfile, ObjectSpec
from drivers.errors import BadValue, SdoProtocolError, UnknownObject
from drivers.master.ground.where import Where
from drivers.master.sdo.client import Priority, SdoClient


class ObjectAccess:
    """Typed reads and writes. Reads are repeated by nobody but the caller; writes never."""

    def __init__(self, node_id: int, profile: DeviceProfile, sdo: SdoClient) -> None:
        self._node_id = node_id
        self.profile = profile
        self._sdo = sdo

    def spec(self, address: Address) -> ObjectSpec:
        """What the profile says of an address. Raises `UnknownObject`."""
        spec = self.profile.find(address)
        if spec is None:
            raise UnknownObject(
                f"A {self.profile.model} has no object {address}.",
                node=self._node_id,
                index=address.index,
                sub=address.sub,
            )
        return spec

    def has(self, index: int, sub: int = 0, axis: int | None = None) -> bool:
        """Whether the model has this object (base index)."""
        try:
            self.profile.spec(index, sub, axis)
        except KeyError:
            return False
        return True

    def address(self, index: int, sub: int = 0, axis: int | None = None) -> Address:
        """The real address of a base index on an axis. Raises `UnknownObject`."""
        try:
            return self.profile.spec(index, sub, axis).address
        except KeyError:
            raise UnknownObject(
                f"A {self.profile.model} has no object {Address(index, sub)} on axis {axis}.",
                node=self._node_id,
                index=index,
                sub=sub,
            ) from None

    def encoded(self, spec: ObjectSpec, value: Value) -> bytes:
        """The bytes of a value. Raises `BadValue` if the object would not take it."""
        where: Where = {"node": self._node_id, "axis": spec.axis, "index": spec.index, "sub": spec.sub}
        if isinstance(value, int) and spec.check(value) is not None:
            span = f"one of {sorted(spec.allowed)}" if spec.allowed else f"{spec.minimum}..{spec.maximum}"
            raise BadValue(f"{spec.address} {spec.name} takes {span}, not {value}.", **where)
        try:
            return encode(spec.type, value)
        except CodecError as error:
            raise BadValue(f"{spec.address} {spec.name}: {error}.", **where) from error

    async def read(self, address: Address, *, priority: Priority = Priority.MONITOR) -> Value:
        """Read an object of the profile. Raises `UnknownObject`, `SdoError`, `BusError`."""
        return await self.read_as(address, self.spec(address).type, priority=priority)

    async def read_as(self, address: Address, data_type: DataType, *, priority: Priority) -> Value:
        """Read an object as a given type, whether the profile has it or not."""
        data = await self._sdo.upload(address, priority=priority)
        if data_type.size is not None and data_type.size < len(data) == 4:
            data = data[: data_type.size]  # an expedited answer that does not indicate its size
        try:
            return decode(data_type, data)
        except CodecError as error:
            raise SdoProtocolError(
                f"Node {self._node_id} answered {address} with what is no {data_type.short}: {error}.",
                node=self._node_id,
                index=address.index,
                sub=address.sub,
            ) from error

    async def read_int(self, address: Address, *, priority: Priority) -> int:
        """Read an object that holds a whole number."""
        value = await self.read(address, priority=priority)
        if not isinstance(value, int):
            raise SdoProtocolError(f"Node {self._node_id}: {address} holds no number.", node=self._node_id)
        return value

    async def write(self, address: Address, value: Value, *, priority: Priority) -> None:
        """Write an object of the profile. Raises `UnknownObject`, `BadValue`, `SdoError`, `BusError`."""
        await self._sdo.download(address, self.encoded(self.spec(address), value), priority=priority)
