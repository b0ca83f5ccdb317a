"""Emergency messages (CiA 301 7.2.7, manual §11.1)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Emergency:
    """Error code, error register (1001h) and five bytes that the maker defines."""

    code: int
    """16 bits; 0000h says that an error is gone."""
    register: int
    """8 bits, as 1001h."""
    data: bytes = bytes(5)
    """Five bytes. In the modules the first tells causes apart, the second is the axis (255: module)."""

    def __post_init__(self) -> None:
        if not (0 <= self.code <= 0xFFFF and 0 <= self.register <= 0xFF and len(self.data) == 5):
            raise ValueError(f"{self!r} does not fit an emergency message")

    @property
    def is_reset(self) -> bool:
        """Whether this says that an error is gone."""
        return self.code == 0

    def encode(self) -> bytes:
        """The eight bytes of COB-ID 80h + node-ID."""
        return self.code.to_bytes(2, "little") + bytes((self.register,)) + self.data

    @classmethod
    def decode(cls, data: bytes) -> Emergency | None:
        """The message, or None for anything but eight bytes."""
        if len(data) != 8:
            return None
        return cls(int.from_bytes(data[:2], "little"), data[2], bytes(data[3:]))
