"""The CAN bus."""

from __future__ import annotations

from app.bus import views
from app.bus.deps import BusDep
from app.bus.schemas import BusReply
from app.http.documentation import problems
from app.http.paths import API
from app.http.routing import Router

router = Router(f"{API}/bus", tags=["bus"])


@router.get("", summary="State and counters of the bus", responses=problems())
async def get_bus(bus: BusDep) -> BusReply:
    """Whether frames flow, and what passed over the wire."""
    return views.bus(bus)
