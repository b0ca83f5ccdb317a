"""Jogging, over a WebSocket. openapi/jog.md is its contract: OpenAPI has no words for it."""

from __future__ import annotations

from fastapi import WebSocket

from app.deps import find_axis
from app.roles import API
from app.routing import Router
from app.schemas.operations import Asker
from app.service import Service
from app.tokens import Principal

router = Router(f"{API}/nodes/{{node}}/axes/{{axis}}")


@router.websocket("/jog")
async def jog_axis(websocket: WebSocket, node: str, axis: str) -> None:
    """Turn the axis while it is held."""
    service: Service = websocket.state.service
    principal: Principal = websocket.state.principal
    address = "" if websocket.client is None else websocket.client.host
    asker = Asker(name=principal.name, address=address)
    await service.jogs.serve(websocket, lambda: find_axis(service, node, axis), asker)
