"""Having a node hold what it should: compared first, written only where it differs, then read back."""

from __future__ import annotations

from typing import Protocol

from drivers.cia301.objects import Address
from drivers.errors import ConfigurationRefused, SdoAborted
from drivers.master.ground.where import Where
from drivers.master.sdo.client import Priority
from drivers.master.sdo.object_access import ObjectAccess
from drivers.master.seen.boot_log import Change


class ChangeLog(Protocol):
    """Who is told what was compared and written."""

    def compared(self) -> None:
        """An object was held against what it should be."""
        ...

    def wrote(self, change: Change) -> None:
        """An object differed and was written."""
        ...


class Establisher:
    """Works through one node's SDO channel and writes down what it did.

    All raise `SdoError` and `BusError`, and `UnknownObject` for what the profile does not have.
    """

    def __init__(self, node_id: int, objects: ObjectAccess, log: ChangeLog) -> None:
        self._node_id = node_id
        self.objects = objects
        self.log = log

    async def hold(self, address: Address, value: int) -> None:
        """Have an object hold `value`. Raises `ConfigurationRefused` with what differs, or `BadValue`."""
        held = await self.read(address)
        if held != value:
            await self.write(address, value)
            await self.confirm(address, value, held)

    async def read(self, address: Address) -> int | None:
        """What an object holds, for a comparison; None where the node refuses to say."""
        self.log.compared()
        try:
            return await self.objects.read_int(address, priority=Priority.CONFIGURE)
        except SdoAborted:
            return None

    async def write(self, address: Address, value: int) -> None:
        """Write an object, to be confirmed. Raises `ConfigurationRefused`, `BadValue`."""
        try:
            await self.objects.write(address, value, priority=Priority.CONFIGURE)
        except SdoAborted as abort:
            raise self._refused(address, value, abort) from abort

    async def confirm(self, address: Address, value: int, before: int | None, *, ignored: int = 0) -> None:
        """Read back what was written over `before`, and note a change. Raises `ConfigurationRefused`.

        `ignored` are bits that the node may hold as it likes.
        """
        spec = self.objects.spec(address)
        try:
            held = await self.objects.read_int(address, priority=Priority.CONFIGURE)
        except SdoAborted as abort:
            raise self._refused(address, value, abort) from abort
        if (held ^ value) & ~ignored:
            raise ConfigurationRefused(
                f"Node {self._node_id} holds {held} in {address} {spec.name} though {value} was written.",
                hint="Check the model and firmware of the module, and that no second master writes to it.",
                **self._where(address),
            )
        if before != value:
            self.log.wrote(Change(address, spec.name, spec.axis, before, value, spec.unit))

    def _refused(self, address: Address, value: int, abort: SdoAborted) -> ConfigurationRefused:
        name = self.objects.spec(address).name
        return ConfigurationRefused(
            f"Node {self._node_id} would not take {value} for {address} {name}: {abort.meaning}.",
            hint="Correct the configured value, or check the model and firmware of the module.",
            **self._where(address),
        )

    def _where(self, address: Address) -> Where:
        axis = self.objects.spec(address).axis
        return {"node": self._node_id, "axis": axis, "index": address.index, "sub": address.sub}
