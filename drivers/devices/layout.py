"""Where the objects of axis 1 and 2 lie: the one place that adds an axis offset."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from drivers.cia301.objects import MappedObject


class Scope(StrEnum):
    """Whom an object belongs to, and thereby which offset its index takes for an axis."""

    COMMUNICATION = "communication"
    """1000h-1FFFh other than PDO parameters: once per module."""
    PDO = "pdo"
    """1400h-1BFFh: PDO parameters, +40h per axis."""
    AXIS = "axis"
    """2000h-21FFh (+200h per axis) and 6000h-67FFh (+800h per axis)."""
    MODULE = "module"
    """27xxh: once per module, no offset."""


@dataclass(frozen=True, slots=True)
class _Area:
    """A run of base indices whose copies for further axes follow at a fixed stride."""

    start: int
    length: int
    stride: int
    scope: Scope


# Manual §2.6.1 and §3.1.15-3.1.18. PDO parameters: 64 numbers per axis in each of the four blocks.
_AREAS = (
    _Area(0x1400, 0x40, 0x40, Scope.PDO),
    _Area(0x1600, 0x40, 0x40, Scope.PDO),
    _Area(0x1800, 0x40, 0x40, Scope.PDO),
    _Area(0x1A00, 0x40, 0x40, Scope.PDO),
    _Area(0x2000, 0x200, 0x200, Scope.AXIS),
    _Area(0x6000, 0x800, 0x800, Scope.AXIS),
)
_PDOS_PER_AXIS = 4
_PDO_NUMBER_STRIDE = 64


@dataclass(frozen=True, slots=True)
class AxisLayout:
    """Maps the index of axis 0 (the "base index", as the manual prints it) to another axis's, and back."""

    axes: int
    """Number of axes, at least 1; axes are counted from 0."""

    def __post_init__(self) -> None:
        if self.axes < 1:
            raise ValueError(f"a module has at least one axis, not {self.axes}")

    def scope(self, base_index: int) -> Scope:
        """Whom the object at `base_index` belongs to."""
        area = _area_of(base_index)
        if area is not None:
            return area.scope
        return Scope.COMMUNICATION if base_index < 0x2000 else Scope.MODULE

    def index(self, base_index: int, axis: int | None) -> int:
        """The index of `axis`'s copy of `base_index`.

        Objects that exist once per module keep their index, whatever `axis` is. Raises ValueError if `axis`
        is not an axis of this module, or is None for an object that each axis has.
        """
        if axis is not None:
            self._require(axis)
        area = _area_of(base_index)
        if area is None:
            return base_index
        if axis is None:
            raise ValueError(f"{base_index:04X}h exists once per axis: which axis?")
        return base_index + axis * area.stride

    def locate(self, index: int) -> tuple[int, int | None]:
        """The base index and the axis of a real index; the axis is None for what exists once per module."""
        for area in _AREAS:
            axis, rest = divmod(index - area.start, area.stride)
            if 0 <= axis < self.axes and rest < area.length:
                return area.start + rest, axis
        return index, None

    def mapped(self, entry: MappedObject, axis: int | None) -> MappedObject:
        """A mapping entry that names an object of axis 0, for `axis`; an empty one (index 0) stays empty."""
        return entry._replace(index=self.index(entry.index, axis)) if entry.index else entry

    def pdo_number(self, number: int, axis: int) -> int:
        """The CANopen number (1..512) of PDO 1..4 of an axis: 1-4, 65-68, 129-132."""
        self._require(axis)
        if not 1 <= number <= _PDOS_PER_AXIS:
            raise ValueError(f"an axis has PDOs 1 to {_PDOS_PER_AXIS}, not {number}")
        return number + axis * _PDO_NUMBER_STRIDE

    def _require(self, axis: int) -> None:
        if not 0 <= axis < self.axes:
            raise ValueError(f"axis {axis} does not exist: the module has axes 0 to {self.axes - 1}")


def _area_of(base_index: int) -> _Area | None:
    return next((area for area in _AREAS if 0 <= base_index - area.start < area.length), None)
