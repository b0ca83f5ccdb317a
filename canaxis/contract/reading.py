"""JSON into frozen dataclasses, by their type hints.

Members that the class doesn't name are passed over, so that a newer service doesn't break this client.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from datetime import datetime
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from canaxis.errors import BadReply

T = TypeVar("T")


def read(kind: type[T], data: object) -> T:
    """`data` as the dataclass `kind`. Raises `BadReply` with the place that doesn't fit."""
    return cast("T", _value(kind, data, kind.__name__))


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    return get_type_hints(kind)


def _value(hint: Any, data: object, where: str) -> object:
    if hint is Any:
        return data
    origin = get_origin(hint)
    if origin is UnionType:  # of one kind and None
        if data is None:
            return None
        return _value(next(each for each in get_args(hint) if each is not NoneType), data, where)
    if origin is tuple:
        rows = cast("list[object]", _of(list, data, where))
        return tuple(_value(get_args(hint)[0], row, f"{where}[{i}]") for i, row in enumerate(rows))
    if origin is Mapping:
        return _of(dict, data, where)
    if is_dataclass(hint):
        return _record(cast("type", hint), data, where)
    if hint is datetime:
        return _time(data, where)
    if hint is float:
        return float(cast("int | float", _of((int, float), data, where)))
    return _of(hint, data, where)


def _record(kind: type, data: object, where: str) -> object:
    members = cast("dict[str, object]", _of(dict, data, where))
    hints = _hints(kind)
    values: dict[str, object] = {}
    for field in fields(kind):
        if field.name in members:
            values[field.name] = _value(hints[field.name], members[field.name], f"{where}.{field.name}")
        elif field.default is MISSING:
            raise BadReply(f"The answer has no {where}.{field.name}.", hint=_HINT)
    return kind(**values)


def _time(data: object, where: str) -> datetime:
    try:
        return datetime.fromisoformat(cast("str", _of(str, data, where)))
    except ValueError as error:
        raise BadReply(f"The answer's {where} is no time: {data!r}.", hint=_HINT) from error


def _of(kind: type | tuple[type, ...], data: object, where: str) -> object:
    if not isinstance(data, kind) or (isinstance(data, bool) and kind is not bool):
        raise BadReply(f"The answer's {where} is not understood: {data!r:.100}.", hint=_HINT)
    return data


_HINT = "Is this a Canaxis service, of a version that suits the client?"
