"""The OpenAPI document: problem responses from THE table, short operation ids, and 3.1.0 kept valid."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, cast

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute

from app.http.problems import MEDIA_TYPE, PROBLEM_TYPES, problem
from app.http.schemas import Problem

Responses = dict[int | str, dict[str, Any]]

DESCRIPTION = """\
Moves stepper axes on a CANopen bus. A moving command answers at once with an operation; ask for the
operation, or send `?wait=SECONDS`. Every number has its unit beside it. Every error is a problem (RFC 9457)
whose `hint` says what to do.

The stop of this service is a *software stop*. It is no emergency stop and no safety function: wire a hardware
stop.
"""

TAGS = [
    {"name": "service", "description": "Whether the service lives, is ready, and how it is doing."},
    {"name": "nodes", "description": "The modules on the bus."},
    {"name": "axes", "description": "The state of an axis, and bringing it to another."},
    {
        "name": "settings",
        "description": "What an axis is set to: changed with read-back, kept, compared, rolled back.",
    },
    {"name": "moves", "description": "Commands that move an axis; each is an operation."},
    {"name": "positions", "description": "Positions of an axis that have names."},
    {"name": "terminals", "description": "Digital and analog inputs and outputs of a module."},
    {"name": "operations", "description": "Commands that take time."},
    {"name": "leases", "description": "Exclusive control of axes, for a while."},
    {"name": "stop", "description": "Software stop for everything; latched until it is reset."},
    {"name": "objects", "description": "Raw access to the object dictionary."},
    {"name": "bus", "description": "The CAN bus."},
    {"name": "events", "description": "Changes as they happen."},
]

ALWAYS = (
    *("token_in_url", "unauthorized", "forbidden_origin", "misdirected"),
    *("bad_request", "too_many_requests", "internal_error"),
)
UNSAFE = ("forbidden_role", "request_timeout", "body_too_large", "json_required")
NODE = ("unknown_node",)
AXIS = (*NODE, "unknown_axis")
REACH = ("node_away", "bus_down", "bus_overflow", "shutting_down", "wrong_identity")
TRANSFER = (
    *("sdo_aborted", "sdo_protocol", "sdo_timeout", "sdo_queue_timeout", "sdo_queue_full"),
    *("configuration_refused", *REACH),
)
KEYS = ("key_in_flight", "key_reused")
LEASES = ("leased", "lease_lost")
STATE = ("not_ready", "axis_busy", "stop_latched", "axis_fault")
UNFINISHED = ("transition_timeout", "motion_failed", "motion_timeout")
NODE_REFUSALS = ("not_ready", "bad_value", "duplicate_node", "transition_timeout")
NODE_COMMAND = (*NODE, *UNSAFE, *KEYS, *LEASES, *TRANSFER, *NODE_REFUSALS)
AXIS_COMMAND = (*AXIS, *UNSAFE, *KEYS, *LEASES, *TRANSFER, *STATE, *UNFINISHED)
SETTINGS_CHANGE = (*UNSAFE, *KEYS, *LEASES, *TRANSFER, "bad_value", "not_ready", "axis_busy", "history_off")
MOVING = (*AXIS_COMMAND, "bad_value", "axis_queue_full")
RETRY_AFTER = {
    "Retry-After": {
        "description": "Seconds after which it is worth to try again, where waiting helps and is known to.",
        "schema": {"type": "integer"},
    }
}


def problems(*codes: str) -> Responses:
    """The problem responses of an operation: those that any has, and these."""
    by_status: dict[int, list[str]] = {}
    for code in dict.fromkeys((*ALWAYS, *codes)):
        by_status.setdefault(PROBLEM_TYPES[code].status, []).append(code)
    return {status: _response(by_status[status]) for status in sorted(by_status)}


def _response(codes: list[str]) -> dict[str, Any]:
    waiting = any(PROBLEM_TYPES[code].wait is not None or code == "axis_busy" for code in codes)
    return {
        "description": "; ".join(PROBLEM_TYPES[code].title for code in codes) + ".",
        **({"headers": RETRY_AFTER} if waiting else {}),
        "content": {
            MEDIA_TYPE: {
                "schema": {"$ref": "#/components/schemas/Problem"},
                "examples": {code: {"$ref": f"#/components/examples/{code}"} for code in codes},
            }
        },
    }


def _example(code: str) -> dict[str, Any]:
    return problem(code, PROBLEM_TYPES[code].title + ".", instance="/api/v1/nodes/1/axes/0/move").body


def operation_id(route: APIRoute) -> str:
    """The name of the function: unique, short, and what a generated client's function is called."""
    return route.name


def build_openapi(app: FastAPI, amend: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """The document, with the problem schema in it and no trace of FastAPI's own error model.

    `amend` says in it who may do what.
    """
    document = get_openapi(
        title=app.title,
        version=app.version,
        openapi_version="3.1.0",
        summary=app.summary,
        description=app.description,
        routes=app.routes,
        tags=TAGS,
        license_info={"name": "MIT", "identifier": "MIT"},
    )
    schemas: dict[str, Any] = document.setdefault("components", {}).setdefault("schemas", {})
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    own = Problem.model_json_schema(ref_template="#/components/schemas/{model}", mode="serialization")
    schemas.update(cast("Mapping[str, Any]", own.pop("$defs", {})))
    schemas["Problem"] = own
    amend(document)
    document["components"]["examples"] = {
        code: {"summary": row.title, "value": _example(code)} for code, row in sorted(PROBLEM_TYPES.items())
    }
    document["components"]["schemas"] = dict(sorted(schemas.items()))
    return document


def render(document: Mapping[str, Any]) -> str:
    """The document as the file that is committed; the same on every machine."""
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"
