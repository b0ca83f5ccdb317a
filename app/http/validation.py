"""A request that doesn't fit its schema, in words: which field, and what it takes.

What the client sent is never repeated: it may not be JSON, and it may be a secret.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

from app.http.problems import ProblemReply, problem

Item = Mapping[str, Any]
"""One error as pydantic describes it."""

_WORDS = {
    "missing": "is required",
    "string_pattern_mismatch": "must fit {pattern}",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_parsing_size": "must be a whole number of fewer digits",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "string_type": "must be a text",
    "string_unicode": "must be a text in Unicode",
    "string_too_short": "must have {min_length} or more characters",
    "string_too_long": "must have at most {max_length} characters",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "enum": "must be {expected}",
    "model_type": "must be a JSON object",
    "model_attributes_type": "must be a JSON object",
    "dict_type": "must be a JSON object",
}
"""Pydantic's types of errors -> what we say; for any other, those of our own validators too, its own message
will do.
"""
NO_JSON = "is no JSON text in UTF-8, or has numbers or brackets beyond all bounds"
MANY = 5
"""Of more errors than this the sentence names the first ones."""


def of_validation(items: Iterable[Item], known: Sequence[str] = ()) -> ProblemReply:
    """The reply, with one entry a field; `known` are the fields that the body may have."""
    messages: dict[str, str] = {}
    for item in items:
        messages.setdefault(_field(item), _message(item, known))
    told = [f"{field} {message}" for field, message in messages.items()]
    more = f"; and {len(told) - MANY} more" if len(told) > MANY else ""
    errors = [{"field": field, "message": message} for field, message in messages.items()]
    return problem("bad_request", f"{'; '.join(told[:MANY])}{more}.", errors=errors)


def of_unreadable() -> ProblemReply:
    """The reply for a body that can't be read at all."""
    return of_validation([{"type": "unreadable", "loc": ("body",), "msg": NO_JSON}])


def _field(item: Item) -> str:
    """The name of the field or parameter, without where it was sent; `body` for the body as a whole."""
    place = cast("Sequence[str | int]", item["loc"])
    if len(place) == 1 or item["type"] == "json_invalid":
        return str(place[0])
    return ".".join(str(part) for part in place[1:])


def _message(item: Item, known: Sequence[str]) -> str:
    kind, context = item["type"], cast("Mapping[str, Any]", item.get("ctx") or {})
    if kind == "json_invalid":
        return f"is no JSON: {context.get('error', '')} at character {item['loc'][-1]}"
    if kind == "missing" and len(item["loc"]) == 1:
        return "must be a JSON object"
    if kind == "extra_forbidden":
        return f"is no field of this request; it has {', '.join(known)}" if known else "must be left out"
    words = _WORDS.get(kind)
    return str(item["msg"]) if words is None else words.format(**context)
