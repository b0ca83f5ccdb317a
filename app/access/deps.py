"""The tickets, for the route that gives them out."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.access.tickets import Tickets
from app.http.parts import Part

TICKETS: Part[Tickets] = Part("tickets")
TicketsDep = Annotated[Tickets, Depends(TICKETS.get)]
