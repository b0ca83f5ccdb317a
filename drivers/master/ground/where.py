"""Where an error belongs: the keyword arguments that every `CanaxisError` takes."""

from __future__ import annotations

from typing import TypedDict


class Where(TypedDict, total=False):
    """Node ID, axis number, index and sub-index, as far as they are known."""

    node: int | None
    axis: int | None
    index: int | None
    sub: int | None
