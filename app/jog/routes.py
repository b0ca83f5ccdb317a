"""Jogging, over a WebSocket. openapi/jog.md is its contract: OpenAPI has no words for it."""

from __future__ import annotations

from fastapi import WebSocket

from app.access.schemas import Asker
from app.access.tokens import Principal
from app.http.finding import NetworkDep, find_axis
from app.http.paths import API
from app.http.routing import Router
from app.jog.deps import JogsDep

router = Router(f"{API}/nodes/{{node}}/axes/{{axis}}")


@router.websocket("/jog")
async def jog_axis(websocket: WebSocket, node: str, axis: str, network: NetworkDep, jogs: JogsDep) -> None:
    """Turn the axis while it is held."""
    principal: Principal = websocket.state.principal
    address = "" if websocket.client is None else websocket.client.host
    asker = Asker(name=principal.name, address=address)
    await jogs.serve(websocket, lambda: find_axis(network, node, axis), asker)
