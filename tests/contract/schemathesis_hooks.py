"""What makes schemathesis go deep here: mostly the names that exist, and no wait of ten minutes."""

from __future__ import annotations

from typing import Any

import schemathesis

LONGEST_WAIT = 0.2
"""Seconds. What the schema doesn't allow is tried as it is; a wait that would be granted is cut short."""


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: dict[str, Any]) -> None:
    """Shorten a wait that the service would grant, in whatever phase it was thought of."""
    del context, kwargs
    if case.query and _granted(case.query.get("wait")):
        case.query["wait"] = LONGEST_WAIT


def _granted(wait: object) -> bool:
    """Whether it is a long wait; some phases write numbers as text already."""
    if isinstance(wait, bool) or not isinstance(wait, int | float | str):
        return False
    try:
        return LONGEST_WAIT < float(wait) <= 600
    except ValueError:
        return False


@schemathesis.hook
def map_path_parameters(context: Any, path_parameters: dict[str, Any] | None) -> dict[str, Any] | None:
    """Name the node and the axis that exist, three times out of four."""
    del context
    for name, known in (("node", ("1", "stage")), ("axis", ("0", "x", "1", "z"))):
        text = str((path_parameters or {}).get(name, ""))
        if (
            path_parameters
            and name in path_parameters
            and (choice := sum(text.encode("utf-8", "replace"))) % 4
        ):
            path_parameters[name] = known[choice % len(known)]
    return path_parameters


@schemathesis.hook
def map_headers(context: Any, headers: Any) -> Any:
    """Leave most idempotency keys out: the same few are drawn again and again, for other requests."""
    del context
    if headers and len(str(headers.get("Idempotency-Key", ""))) % 8:
        del headers["Idempotency-Key"]
    return headers
