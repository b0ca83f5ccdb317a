"""Saving and restoring parameters: 1010h, 1011h, 2706h (manual §3.1.7, §3.1.8, §4.2.64)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from drivers.cia301.objects import Address
from drivers.cia301.sdo import AbortCode, SdoAbort
from drivers.devices.profile import ObjectSpec, StoreGroup
from drivers.sim.dictionary import ObjectDictionary
from drivers.sim.storage import Store, StoreError

SAVE: Final = 0x65766173
LOAD: Final = 0x64616F6C

STORE_PARAMETERS: Final = 0x1010
RESTORE_PARAMETERS: Final = 0x1011
STORE_ADDRESSING: Final = 0x2706
BIT_RATE: Final = Address(0x2704)
NODE_ID: Final = Address(0x2705)

_ALL, _COMMUNICATION, _FIRST_AXIS = 1, 2, 4

Chosen = Callable[[ObjectSpec], bool]


def _nothing(_spec: ObjectSpec) -> bool:
    return False


class ParameterMemory:
    """What is saved, and the commands that save it; a `Watcher` of the dictionary.

    A restore only forgets what was saved: the defaults hold from the next reset on. By the manual, "restore
    communication parameters" has no function: every restore keeps node ID and bit rate. Unverified on
    hardware.
    """

    def __init__(self, dictionary: ObjectDictionary, store: Store) -> None:
        self._dictionary = dictionary
        self._store = store
        dictionary.watch((STORE_PARAMETERS, RESTORE_PARAMETERS, STORE_ADDRESSING), self)

    def saved(self) -> Mapping[Address, int]:
        """What was saved, as far as this module knows the objects; nothing if the memory can't be read."""
        try:
            values = self._store.load()
        except StoreError:
            return {}
        objects = self._dictionary.profile.objects
        return {
            address: value
            for address, value in values.items()
            if (spec := objects.get(address)) is not None
            and spec.stored is not None
            and spec.check(value) is None
        }

    def save_addressing(self, node_id: int, bit_rate: int) -> None:
        """Keep a node ID (255 = unconfigured) and a bit rate in kbit/s. Raises `StoreError`."""
        self._store.save({**self._store.load(), NODE_ID: node_id, BIT_RATE: bit_rate})

    # --- Watcher --------------------------------------------------------------------------------------------

    def veto(self, address: Address, value: int, now: float) -> AbortCode | None:  # noqa: ARG002
        """See `Watcher.veto`: 08000020h for a wrong signature or a group that can't be stored."""
        signature = LOAD if address.index == RESTORE_PARAMETERS else SAVE
        possible = self._dictionary.stored(address) != 0
        return None if value == signature and possible else AbortCode.CANNOT_STORE

    def written(self, address: Address, value: int, now: float) -> None:  # noqa: ARG002
        """See `Watcher.written`: 06060000h if the memory fails. The object goes on to read 1."""
        self._dictionary.store(address, 1)
        try:
            if address.index == RESTORE_PARAMETERS:
                self._forget(self._to_restore(address.sub))
            else:
                self._keep(self._to_save(address))
        except StoreError:
            raise SdoAbort(AbortCode.HARDWARE_ERROR) from None

    # --- groups ---------------------------------------------------------------------------------------------

    def _to_save(self, address: Address) -> Chosen:
        if address.index == STORE_ADDRESSING or address.sub == _COMMUNICATION:
            return lambda spec: spec.stored is StoreGroup.COMMUNICATION
        if address.sub == _ALL:
            return lambda spec: spec.stored is not None
        return lambda spec: spec.stored is StoreGroup.AXIS and spec.axis == address.sub - _FIRST_AXIS

    def _to_restore(self, sub: int) -> Chosen:
        if sub == _COMMUNICATION:
            return _nothing
        if sub == _ALL:
            return lambda spec: spec.stored is not StoreGroup.COMMUNICATION
        return lambda spec: spec.axis == sub - _FIRST_AXIS

    def _keep(self, chosen: Chosen) -> None:
        values = {
            address: self._dictionary.stored(address)
            for address, spec in self._dictionary.profile.objects.items()
            if spec.access.writable and chosen(spec)
        }
        self._store.save({**self._store.load(), **values})

    def _forget(self, chosen: Chosen) -> None:
        objects = self._dictionary.profile.objects
        kept = {
            address: value
            for address, value in self._store.load().items()
            if (spec := objects.get(address)) is None or not chosen(spec)
        }
        self._store.save(kept)
