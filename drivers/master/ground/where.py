"""Which axis something is about, and where an error belongs."""

from __future__ import annotations

from typing import NamedTuple, TypedDict


class AxisId(NamedTuple):
    """The numbers of one axis of a bus."""

    node: int
    """The ID of its node."""
    number: int
    """Which of the node's axes, counted from 0."""


class Where(TypedDict, total=False):
    """The keyword arguments that every `CanaxisError` takes: node ID, axis number, index and sub-index, as
    far as they are known.
    """

    node: int | None
    axis: int | None
    index: int | None
    sub: int | None
