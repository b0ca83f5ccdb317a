"""Tickets for streams that a browser opens."""

from __future__ import annotations

from fastapi import Depends, Request

from app.access.deps import TicketsDep
from app.access.schemas import TicketReply
from app.access.tickets import LIFETIME
from app.access.tokens import Principal
from app.http.documentation import UNSAFE, problems
from app.http.parameters import empty_body
from app.http.paths import API
from app.http.routing import Router

router = Router(f"{API}/tickets", tags=["events"])


@router.post(
    "",
    summary="A ticket for a stream",
    status_code=201,
    dependencies=[Depends(empty_body)],
    responses=problems(*UNSAFE),
)
async def issue_ticket(request: Request, tickets: TicketsDep) -> TicketReply:
    """A browser's EventSource can't send a token: it opens the stream with `?ticket=` instead.

    A ticket is good once and soon, for streams alone, with the role of the token that asked for it.
    """
    principal: Principal = request.state.principal
    ticket = tickets.issue(principal)
    return TicketReply(ticket=ticket, role=principal.role.word, expires_in_s=LIFETIME)
