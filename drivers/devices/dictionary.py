"""From the object tables of a module's data files to the `ObjectSpec`s of all its axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from drivers.cia301.objects import Address, MappedObject
from drivers.cia301.types import DataType
from drivers.cia402.power import PowerState
from drivers.devices.layout import AxisLayout, Scope
from drivers.devices.profile import Access, ObjectKind, ObjectSpec, StoreGroup
from drivers.devices.tables import DataError, Table

_TYPES = {data_type.short: data_type for data_type in DataType}
_LONGEST_RUN = 0x1_0000
"""Values that one key of ``allowed`` may stand for: each takes a place in memory."""


def read_objects(file: Table, layout: AxisLayout) -> Iterator[ObjectSpec]:
    """Every entry, for every axis, that the `object` tables of one file define. Raises DataError.

    Keys of the file: ``scope``, which each object's index must agree with, and ``object``.
    Keys of an object: index, name, section, kind, description, note, copies; and those of an entry for a VAR,
    for others ``sub`` with a table per sub-index.
    Keys of an entry: type, access, range, allowed, default, printed, default_of_further_axes, node_relative,
    mapping_entry, mappable, unit, stored, writable_in.
    """
    scope = file.word("scope", Scope)
    for content in file.raw_tables("object"):
        copies = content.get("copies", 1)
        if not isinstance(copies, int):
            raise DataError(f"{file.where}: copies is not a number")
        for axis in range(layout.axes) if scope in (Scope.AXIS, Scope.PDO) else (None,):
            for copy in range(copies):
                yield from _Expansion(content, file.where, scope, layout, axis, copy).entries()
    file.close()


class _Expansion:
    """One object table, for one axis and one of its copies."""

    def __init__(
        self,
        content: Mapping[str, object],
        where: str,
        scope: Scope,
        layout: AxisLayout,
        axis: int | None,
        copy: int,
    ) -> None:
        table = Table(content, where)
        self._table = table
        self._layout = layout
        self._scope = scope
        self._axis = axis
        self._copy = copy
        self._base_index = table.integer("index") + copy
        table.where = f"{where}, {self._base_index:04X}h"
        if layout.scope(self._base_index) is not scope:
            raise DataError(f"{table.where}: its index is not one of scope {scope}")
        self._name = table.text("name")
        if axis is not None and scope is Scope.PDO:
            self._name = self._name.format(n=layout.pdo_number(copy + 1, axis))
        self._section = table.text("section")
        self._kind = table.word("kind", ObjectKind, ObjectKind.VAR)
        self._description = table.text("description")
        self._note = table.text("note", "")
        table.integer("copies", 1)

    def entries(self) -> Iterator[ObjectSpec]:
        """The entries in order of their sub-index."""
        if self._kind is ObjectKind.VAR:
            yield self._entry(self._table, 0, self._name, self._description, self._note)
        else:
            for number, sub in enumerate(self._table.tables("sub")):
                sub.where = f"{self._table.where}:{number}"
                if sub.integer("sub") != number:
                    raise DataError(f"{sub.where}: the sub-indices don't follow each other from 0")
                yield self._sub_entry(sub, number)
        self._table.close()

    def _sub_entry(self, sub: Table, number: int) -> ObjectSpec:
        description = sub.text("description", self._description)
        spec = self._entry(sub, number, sub.text("name"), description, sub.text("note", self._note))
        sub.close()
        return spec

    def _entry(self, table: Table, sub: int, name: str, description: str, note: str) -> ObjectSpec:
        allowed = _allowed(table)
        low, high = _range(table, allowed)
        default, printed, node_relative = self._default(table)
        stored = table.text("stored", "")
        spec = ObjectSpec(
            index=self._layout.index(self._base_index, self._axis),
            sub=sub,
            base_index=self._base_index,
            name=name,
            object_name=self._name,
            kind=self._kind,
            type=_type(table),
            access=table.word("access", Access),
            scope=self._scope,
            section=self._section,
            mappable=table.flag("mappable"),
            low=low,
            high=high,
            allowed=allowed,
            default=default,
            printed_default=printed,
            node_relative=node_relative,
            unit=table.text("unit", ""),
            axis=self._axis,
            writable_in=frozenset(map(PowerState, table.texts("writable_in"))) or None,
            stored=StoreGroup(stored) if stored else None,
            description=description,
            note=note,
        )
        _require_sense(spec, table.where)
        return spec

    def _default(self, table: Table) -> tuple[int | str | None, int | str | None, bool]:
        """The default, what the manual prints instead, and whether the node ID is added to both."""
        default = table.integer_or_text("default", self._copy)
        printed = table.integer_or_text("printed", self._copy)
        node_relative = table.flag("node_relative")
        of_further_axes = table.integer_or_text("default_of_further_axes")
        if self._axis and of_further_axes is not None:
            return of_further_axes, None, False
        if table.flag("mapping_entry") and isinstance(default, int):
            default = self._layout.mapped(MappedObject.decode(default), self._axis).encode()
        return default, printed, node_relative


def _type(table: Table) -> DataType:
    name = table.text("type")
    if name not in _TYPES:
        raise DataError(f"{table.where}: there is no type {name!r}; there are {', '.join(_TYPES)}")
    return _TYPES[name]


def _range(table: Table, allowed: Mapping[int, str] | None) -> tuple[int | None, int | None]:
    limits = table.integers("range")
    if not limits:
        return (min(allowed), max(allowed)) if allowed else (None, None)
    if len(limits) != 2 or limits[0] > limits[1]:
        raise DataError(f"{table.where}: range is not [low, high]")
    return limits[0], limits[1]


def _allowed(table: Table) -> Mapping[int, str] | None:
    """Keys are values ("5") or runs of them ("2..15"), which share a label."""
    labels = table.table("allowed")
    if labels is None:
        return None
    values: dict[int, str] = {}
    for key in labels.names():
        first, _, last = key.partition("..")
        label = labels.text(key)
        try:
            run = range(int(first), int(last or first) + 1)
        except ValueError:
            raise DataError(f"{labels.where}: {key!r} is no number and no run of numbers") from None
        if len(run) > _LONGEST_RUN:
            raise DataError(f"{labels.where}: {key!r} is a run of more than {_LONGEST_RUN} numbers")
        for value in run:
            if value in values:
                raise DataError(f"{labels.where}: {value} stands there twice")
            values[value] = label
    return MappingProxyType(values)


def _require_sense(spec: ObjectSpec, where: str) -> None:
    if spec.mappable and spec.type.bits is None:
        raise DataError(f"{where}: an object without a fixed size can't be mapped")
    if spec.stored is not None and spec.access is not Access.RW:
        raise DataError(f"{where}: only what can be written can be stored")
    for value in (spec.low, spec.high, spec.default):
        if isinstance(value, int) and not spec.type.minimum <= value <= spec.type.maximum:
            raise DataError(f"{where}: {value} does not fit {spec.type.short}")
    if isinstance(spec.default, int) and spec.check(spec.default) is not None:
        raise DataError(f"{where}: the default {spec.default} is outside of the range")


def index_objects(specs: Iterator[ObjectSpec]) -> Mapping[Address, ObjectSpec]:
    """By address, in order of address. Raises DataError if an address stands twice."""
    objects: dict[Address, ObjectSpec] = {}
    for spec in specs:
        if spec.address in objects:
            raise DataError(f"{spec.address} is defined twice")
        objects[spec.address] = spec
    return MappingProxyType(dict(sorted(objects.items())))
