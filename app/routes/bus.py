"""The CAN bus."""

from __future__ import annotations

from app import views
from app.deps import ServiceDep
from app.documentation import problems
from app.roles import API
from app.routing import Router
from app.schemas.system import BusReply

router = Router(f"{API}/bus", tags=["bus"])


@router.get("", summary="State and counters of the bus", responses=problems())
async def get_bus(service: ServiceDep) -> BusReply:
    """Whether frames flow, and what passed over the wire."""
    return views.bus(service)
