"""Tickets for streams that a browser opens."""

from __future__ import annotations

from fastapi import Depends, Request

from app.deps import ServiceDep, empty_body
from app.documentation import UNSAFE, problems
from app.roles import API
from app.routing import Router
from app.schemas.system import TicketReply
from app.tickets import LIFETIME
from app.tokens import Principal

router = Router(f"{API}/tickets", tags=["events"])


@router.post(
    "",
    summary="A ticket for a stream",
    status_code=201,
    dependencies=[Depends(empty_body)],
    responses=problems(*UNSAFE),
)
async def issue_ticket(request: Request, service: ServiceDep) -> TicketReply:
    """A browser's EventSource can't send a token: it opens the stream with `?ticket=` instead.

    A ticket is good once and soon, for streams alone, with the role of the token that asked for it.
    """
    principal: Principal = request.state.principal
    ticket = service.tickets.issue(principal)
    return TicketReply(ticket=ticket, role=principal.role.word, expires_in_s=LIFETIME)
