"""The stream of events."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header
from fastapi.responses import Response

from app.deps import ServiceDep
from app.documentation import Responses, problems

router = APIRouter(prefix="/events", tags=["events"])

STREAM: Responses = {
    200: {
        "description": (
            "Server-sent events. `snapshot` first (`bus`, `stop`, `nodes`, `axes`, `operations`), "
            "then `axis`, `node`, `bus`, `emergency`, `motion`, `stop` as they happen, and `missed` "
            "where this client was too slow. Comments keep the connection open."
        ),
        "content": {
            "text/event-stream": {
                "schema": {"type": "string"},
                "example": 'id: 7\nevent: stop\ndata: {"latched":true,"reason":"A hand is in the way."}\n\n',
            }
        },
    }
}


@router.get(
    "",
    summary="Changes as they happen",
    response_class=Response,
    responses={**STREAM, **problems("too_many_streams", "shutting_down")},
)
async def stream_events(
    service: ServiceDep,
    last_event_id: Annotated[
        str | None,
        Header(alias="Last-Event-ID", max_length=20, description="Replay what was missed since this event."),
    ] = None,
) -> Response:
    """Everything once, then what changes.

    A client that comes back with `Last-Event-ID` gets what it missed.
    """
    known = last_event_id if last_event_id and last_event_id.isascii() and last_event_id.isdecimal() else None
    return service.streams.open(None if known is None else int(known))
