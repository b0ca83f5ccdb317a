"""SYNC messages, with or without the counter (CiA 301 7.2.5)."""

from __future__ import annotations

from typing import Final, NamedTuple

MAX_COUNTER: Final = 240


class Sync(NamedTuple):
    """A SYNC; `counter` 1..240, or None where the producer sends none."""

    counter: int | None = None


def encode(counter: int | None = None) -> bytes:
    """No byte, or the counter's. ValueError outside 1..240."""
    if counter is None:
        return b""
    if not 1 <= counter <= MAX_COUNTER:
        raise ValueError(f"a SYNC counter of {counter} is not in 1..{MAX_COUNTER}")
    return bytes((counter,))


def decode(data: bytes) -> Sync | None:
    """The SYNC, or None for what is none."""
    if not data:
        return Sync()
    if len(data) == 1 and 1 <= data[0] <= MAX_COUNTER:
        return Sync(data[0])
    return None
