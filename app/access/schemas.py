"""Who asks, and what opens a stream, on the wire."""

from __future__ import annotations

from pydantic import Field

from app.http import examples
from app.http.schemas import Reply

_TICKET: examples.Example = {
    "ticket": "Q2lyY3VsYXIgZG9vcnMgYXJlIHJhcmUu",
    "role": "read",
    "expires_in_s": 30.0,
}


class TicketReply(Reply):
    """What opens one stream, once."""

    model_config = examples.shown(_TICKET)

    ticket: str = Field(description="For the query parameter `ticket` of a stream.")
    role: str = Field(description="read, stop, move or configure: that of the token it was asked with.")
    expires_in_s: float


class Asker(Reply):
    """Who asked for it."""

    name: str = Field(description="The name of the token; `anonymous` where none is needed.")
    address: str = Field(description="Network address of the client; empty where there is none.")
