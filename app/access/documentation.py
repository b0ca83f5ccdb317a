"""What the OpenAPI document says of access: how to show who one is, and what each operation needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from app.access.roles import is_cancel, is_stop, role_for

TICKET = "ticket"
"""The name of the security scheme of streams."""


def describe_access(document: dict[str, Any]) -> None:
    """Add the security schemes; say of each operation which role it needs.

    The refusals that a stop never gets are left out.
    """
    document["components"]["securitySchemes"] = {
        "token": {
            "type": "http",
            "scheme": "bearer",
            "description": "Needed where tokens are set; `x-role` is the least role that an operation needs.",
        },
        TICKET: {
            "type": "apiKey",
            "in": "query",
            "name": "ticket",
            "description": "From POST /api/v1/tickets: opens one stream, once, within 30 s.",
        },
    }
    document["security"] = [{}, {"token": []}]
    for path, operations in cast("Mapping[str, Mapping[str, dict[str, Any]]]", document["paths"]).items():
        for method, operation in operations.items():
            operation["x-role"] = role_for(method.upper(), path).word
            if is_stop(path) or is_cancel(path):
                operation["responses"].pop("429", None)
                operation["responses"].pop("423", None)
