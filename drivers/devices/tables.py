"""Typed and strict reading of TOML: a wrong type, a missing or an unknown key is an error that says where."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import TypeVar, cast

_T = TypeVar("_T")
_E = TypeVar("_E", bound=StrEnum)


class DataError(ValueError):
    """A data file is wrong; the message says where and why."""


class Table:
    """One TOML table. Each getter takes its key out; `close` refuses what is left."""

    def __init__(self, content: Mapping[str, object], where: str) -> None:
        self._rest = dict(content)
        self.where = where

    def text(self, key: str, default: str | None = None) -> str:
        """A string."""
        return self._required(key, str, default)

    def integer(self, key: str, default: int | None = None) -> int:
        """An integer."""
        return self._required(key, int, default)

    def word(self, key: str, words: type[_E], default: _E | None = None) -> _E:
        """A string that is one of `words`."""
        value = self._required(key, str, default)
        try:
            return words(value)
        except ValueError:
            raise self._error(f"{key} is {value!r}, which is none of {', '.join(words)}") from None

    def flag(self, key: str) -> bool:
        """A boolean; false if absent."""
        return self._required(key, bool, False)

    def integer_or_text(self, key: str, position: int = 0) -> int | str | None:
        """An integer or a string, None if absent; of a list, the item at `position`."""
        value = self._rest.pop(key, None)
        if isinstance(value, list):
            items = cast("list[object]", value)
            if position >= len(items):
                raise self._error(f"{key} has no item {position}")
            value = items[position]
        if value is None or (isinstance(value, int | str) and not isinstance(value, bool)):
            return value
        raise self._error(f"{key} is neither a number nor a text")

    def integers(self, key: str) -> tuple[int, ...]:
        """A list of integers; empty if absent."""
        return tuple(self._item(key, item, int) for item in self._list(key))

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of strings; empty if absent."""
        return tuple(self._item(key, item, str) for item in self._list(key))

    def table(self, key: str) -> Table | None:
        """A table inside this one, None if absent."""
        value = self._rest.pop(key, None)
        return None if value is None else self._as_table(value, key)

    def tables(self, key: str) -> tuple[Table, ...]:
        """A list of tables; empty if absent."""
        return tuple(
            self._as_table(item, f"{key} {position}") for position, item in enumerate(self._list(key))
        )

    def raw_tables(self, key: str) -> tuple[Mapping[str, object], ...]:
        """A list of tables as they are, to be read more than once; empty if absent."""
        return tuple(cast("dict[str, object]", self._item(key, item, dict)) for item in self._list(key))

    def names(self) -> tuple[str, ...]:
        """The keys that have not been taken yet."""
        return tuple(self._rest)

    def close(self) -> None:
        """Raise DataError if a key has not been taken: it is misspelled."""
        if self._rest:
            raise self._error(f"unknown key {', '.join(sorted(self._rest))}")

    def _required(self, key: str, wanted: type[_T], default: _T | None) -> _T:
        if key not in self._rest:
            if default is None:
                raise self._error(f"{key} is missing")
            return default
        return self._item(key, self._rest.pop(key), wanted)

    def _item(self, key: str, value: object, wanted: type[_T]) -> _T:
        if isinstance(value, wanted) and not (wanted is int and isinstance(value, bool)):
            return value
        raise self._error(f"{key} is not of type {wanted.__name__}: {value!r}")

    def _list(self, key: str) -> list[object]:
        value = self._rest.pop(key, [])
        if not isinstance(value, list):
            raise self._error(f"{key} is not a list")
        return cast("list[object]", value)

    def _as_table(self, value: object, key: str) -> Table:
        if not isinstance(value, dict):
            raise self._error(f"{key} is not a table")
        return Table(cast("dict[str, object]", value), f"{self.where}, {key}")

    def _error(self, message: str) -> DataError:
        return DataError(f"{self.where}: {message}")
