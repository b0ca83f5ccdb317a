"""Nodes, and what they reported."""

from __future__ import annotations

from fastapi import APIRouter

from app import views
from app.deps import NodeDep, ServiceDep
from app.documentation import NODE, problems
from app.schemas.nodes import EmergencyList, NodeList, NodeReply

router = APIRouter(prefix="/nodes", tags=["nodes"])


@router.get("", summary="All configured nodes", responses=problems())
async def list_nodes(service: ServiceDep) -> NodeList:
    """Every module that the settings name, whether it is there or not."""
    return NodeList(nodes=[views.node(node) for node in service.network.nodes.values()])


@router.get("/{node}", summary="One node", responses=problems(*NODE))
async def get_node(node: NodeDep) -> NodeReply:
    """What the module is, how far it is configured, and why it is not if it is not."""
    return views.node(node)


@router.get("/{node}/emergencies", summary="What a node reported", responses=problems(*NODE))
async def list_emergencies(node: NodeDep) -> EmergencyList:
    """The node's last emergencies with cause and remedy, the newest first."""
    return EmergencyList(emergencies=[views.emergency(record) for record in reversed(node.emergencies)])
