"""The stream of events."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import Header
from fastapi.responses import Response

from app.access.documentation import TICKET
from app.events.deps import StreamsDep
from app.http.documentation import Responses, problems
from app.http.paths import API
from app.http.routing import Router

router = Router(f"{API}/events", tags=["events"])
_EVENT_ID = re.compile(r"[0-9]{1,18}")

STREAM: Responses = {
    200: {
        "description": (
            "Server-sent events. `snapshot` first (`bus`, `stop`, `nodes`, `axes`, `operations`), "
            "then `axis`, `node`, `bus`, `emergency`, `motion`, `stop` as they happen, and `missed` "
            "where this client was too slow. Comments keep the connection open. openapi/events.md has "
            "the fields of each, with examples."
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
    openapi_extra={"security": [{}, {"token": []}, {TICKET: []}]},
    responses={**STREAM, **problems("too_many_streams", "shutting_down")},
)
async def stream_events(
    streams: StreamsDep,
    last_event_id: Annotated[
        str | None,
        Header(
            alias="Last-Event-ID",
            description="Replay what was missed since this event; ignored if it is no event's number.",
        ),
    ] = None,
) -> Response:
    """Everything once, then what changes.

    A client that comes back with `Last-Event-ID` gets what it missed.
    """
    known = _EVENT_ID.fullmatch(last_event_id or "")
    return streams.open(None if known is None else int(known[0]))
