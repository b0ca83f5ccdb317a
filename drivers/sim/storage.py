"""What a module remembers without its supply: a `Store`, in memory or in a file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, cast

from drivers.cia301.objects import Address


class StoreError(Exception):
    """The memory could not be read or written; the sentence says why."""


class Store(Protocol):
    """Non-volatile memory for numbers by address."""

    def load(self) -> Mapping[Address, int]:
        """All that was saved last. Raises `StoreError`."""
        ...

    def save(self, values: Mapping[Address, int]) -> None:
        """Replace all that was saved, or raise `StoreError` and change nothing."""
        ...


class MemoryStore:
    """Survives a power cycle of the module, but not the process. `broken` makes every save fail."""

    def __init__(self) -> None:
        self._values: dict[Address, int] = {}
        self.broken = False

    def load(self) -> Mapping[Address, int]:
        """See `Store.load`."""
        return dict(self._values)

    def save(self, values: Mapping[Address, int]) -> None:
        """See `Store.save`."""
        if self.broken:
            raise StoreError("the memory is broken, as it was told to be")
        self._values = dict(values)


class FileStore:
    """Survives the process too: a JSON file of ``{"2000h:0": 8, ...}``, replaced as a whole."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def load(self) -> Mapping[Address, int]:
        """See `Store.load`. A file that does not exist holds nothing."""
        try:
            parsed: object = json.loads(self._path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, RecursionError) as error:
            raise StoreError(f"{self._path} can't be read: {error}") from error
        if not isinstance(parsed, dict):
            raise StoreError(f"{self._path} holds no table of objects")
        return dict(self._entry(key, value) for key, value in cast("dict[str, object]", parsed).items())

    def save(self, values: Mapping[Address, int]) -> None:
        """See `Store.save`."""
        text = json.dumps({str(address): value for address, value in sorted(values.items())}, indent=1)
        beside = self._path.with_name(self._path.name + ".new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with beside.open("w", encoding="utf-8") as file:
                file.write(text + "\n")
                file.flush()
                os.fsync(file.fileno())
            beside.replace(self._path)
        except OSError as error:
            raise StoreError(f"{self._path} can't be written: {error}") from error

    def _entry(self, key: str, value: object) -> tuple[Address, int]:
        index, _, sub = key.partition("h:")
        try:
            address = Address(int(index, 16), int(sub))
        except ValueError:
            raise StoreError(f"{self._path}: {key!r} is no object") from None
        if not isinstance(value, int) or isinstance(value, bool):
            raise StoreError(f"{self._path}: {key} holds {value!r}, which is no number")
        return address, value
