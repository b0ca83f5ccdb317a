"""The head of a request, as far as it is looked at."""

from __future__ import annotations

from starlette.types import Scope

_LOOKED_AT = frozenset(
    {
        b"host",
        b"origin",
        b"sec-fetch-site",
        b"sec-fetch-mode",
        b"authorization",
        b"content-type",
        b"content-length",
    }
)


class Head:
    """The headers that are looked at, found in one pass: this is done for every status request."""

    __slots__ = ("_values",)

    def __init__(self, scope: Scope) -> None:
        self._values: dict[bytes, list[str]] = {}
        for name, value in scope["headers"]:
            if name in _LOOKED_AT:
                self._values.setdefault(name, []).append(value.decode("latin-1"))

    def all(self, name: bytes) -> list[str]:
        """Every value of a header."""
        return self._values.get(name, [])

    def first(self, name: bytes) -> str:
        """Its first value; empty if there is none."""
        values = self._values.get(name)
        return values[0] if values else ""

    @property
    def media_type(self) -> str:
        """The content type, without its parameters, in lower case."""
        return self.first(b"content-type").partition(";")[0].strip().lower()

    @property
    def length(self) -> int | None:
        """The length that the body is said to have."""
        text = self.first(b"content-length")
        return int(text[:20]) if text.isascii() and text.isdigit() else None
