"""Where an object lives, and how a PDO mapping entry names it."""

from __future__ import annotations

from typing import NamedTuple


class Address(NamedTuple):
    """Index (16 bits) and sub-index (8 bits) of an object."""

    # The field hides tuple.index(), which nobody needs of an address.
    index: int  # pyright: ignore[reportIncompatibleMethodOverride]
    sub: int = 0

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.sub}"


class MappedObject(NamedTuple):
    """One entry of a PDO mapping record (1600h.., 1A00h..; CiA 301 7.5.2.36)."""

    index: int  # pyright: ignore[reportIncompatibleMethodOverride]
    sub: int
    bits: int

    @property
    def address(self) -> Address:
        """The object that is mapped."""
        return Address(self.index, self.sub)

    def encode(self) -> int:
        """As the entry's UNSIGNED32: 60640020h is 32 bits of 6064h:0. ValueError if a part is too large."""
        if not (0 <= self.index <= 0xFFFF and 0 <= self.sub <= 0xFF and 0 <= self.bits <= 0xFF):
            raise ValueError(f"{self!r} does not fit a mapping entry")
        return self.index << 16 | self.sub << 8 | self.bits

    @classmethod
    def decode(cls, value: int) -> MappedObject:
        """From the entry's UNSIGNED32."""
        return cls(value >> 16 & 0xFFFF, value >> 8 & 0xFF, value & 0xFF)

    def __str__(self) -> str:
        return f"{self.address}/{self.bits}"
