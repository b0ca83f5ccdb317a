"""How the document describes the answer to a command that takes time."""

from __future__ import annotations

from typing import Any

from app.http.documentation import Responses
from app.operations.schemas import OperationReply


def location_header() -> dict[str, Any]:
    """How the document describes the Location header."""
    return {"Location": {"description": "Where the operation is.", "schema": {"type": "string"}}}


def preference_header() -> dict[str, Any]:
    """How the document describes the Preference-Applied header."""
    return {"Preference-Applied": {"description": "The wait that was granted.", "schema": {"type": "string"}}}


def operation_links() -> dict[str, Any]:
    """Where a client goes from a reply that holds an operation; schemathesis goes there too."""
    by_id = {"parameters": {"id": "$response.body#/id"}}
    return {
        "operation": {"operationId": "get_operation", "description": "How far it is.", **by_id},
        "cancel": {"operationId": "cancel_operation", "description": "End it.", **by_id},
    }


ANSWERED: Responses = {
    200: {
        "description": "It ended while the request waited; `state` says how.",
        "model": OperationReply,
        "headers": preference_header(),
        "links": operation_links(),
    },
    202: {
        "description": "It is under way; ask at `Location`.",
        "model": OperationReply,
        "headers": {**location_header(), **preference_header()},
        "links": operation_links(),
    },
}
"""How a command that takes time answers if it isn't refused."""
