"""What is to be said of a setting beside its name, its meaning and its default: `setting` makes the row."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Final, Literal, TypeVar

_KEY: Final = "setting"
_T = TypeVar("_T")


class Dimension(enum.StrEnum):
    """What a setting's number is: its value is what follows the axis's unit, or a unit of its own."""

    POSITION = ""
    VELOCITY = "/s"
    ACCELERATION = "/s2"
    TIME = "ms"
    CURRENT = "%"

    @property
    def has_own_unit(self) -> bool:
        """Whether the axis's unit has no part in it."""
        return self in (Dimension.TIME, Dimension.CURRENT)


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting that is one value."""

    dimension: Dimension | None
    """None: no number with a unit."""
    at: tuple[int, int] | None
    """Index (of axis 0) and sub-index of the object that holds it; None: the master alone goes by it."""
    lowest: Literal[0, 1] | None
    """Of a rate, whose highest is `HIGHEST_RATE`; None: a rule of its own, or what its object takes."""
    maximum: Literal["max_velocity", "max_acceleration"] | None
    """The setting that it must not pass."""
    signed: bool
    """Whether it has a direction: else it counts without a sign."""
    tick_us: int
    """Of a time: microseconds of one in the object."""
    counts: str | None
    """The attribute with what counts where it is None; None: itself."""
    written: Callable[[Any], int] | None
    """From its value to the object's; None: as it is."""
    still: bool
    """Written only in SWITCH_ON_DISABLED though the manual allows it at any time: it changes what a step or
    a position is.
    """


def setting(
    default: _T,
    dimension: Dimension | None = None,
    *,
    at: int | tuple[int, int] | None = None,
    lowest: Literal[0, 1] | None = None,
    maximum: Literal["max_velocity", "max_acceleration"] | None = None,
    signed: bool = False,
    tick_us: int = 1000,
    counts: str | None = None,
    written: Callable[[Any], int] | None = None,
    still: bool = False,
) -> _T:
    """A field of a dataclass with its row; see `Setting`. An index alone in `at` has sub-index 0."""
    held = (at, 0) if isinstance(at, int) else at
    row = Setting(dimension, held, lowest, maximum, signed, tick_us, counts, written, still)
    return field(default=default, metadata={_KEY: row})


def settings_of(owner: type) -> dict[str, Setting]:
    """The rows of a dataclass by name, in its order."""
    return {each.name: each.metadata[_KEY] for each in fields(owner) if _KEY in each.metadata}
