"""Nodes, and what they reported."""

from __future__ import annotations

from fastapi import Depends

from app.axes.deps import NodeDep
from app.http.documentation import NODE, NODE_COMMAND, problems
from app.http.finding import NetworkDep, every_axis_of
from app.http.parameters import LeaseToken, empty_body
from app.http.paths import API
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.idempotency.deps import command_headers
from app.leases.deps import LeasesDep
from app.nodes import views
from app.nodes.schemas import EmergencyList, NodeList, NodeReply

router = Router(f"{API}/nodes", tags=["nodes"])
commands = Router(
    f"{API}/nodes/{{node}}",
    tags=["nodes"],
    dependencies=[Depends(command_headers), Depends(empty_body)],
    responses=problems(*NODE_COMMAND),
)


@router.get("", summary="All configured nodes", responses=problems())
async def list_nodes(network: NetworkDep) -> NodeList:
    """Every module that the settings name, whether it is there or not."""
    return NodeList(nodes=[views.node(node) for node in network.nodes.values()])


@router.get("/{node}", summary="One node", responses=problems(*NODE))
async def get_node(node: NodeDep) -> NodeReply:
    """What the module is, how far it is configured, and why it is not if it is not."""
    return views.node(node)


@router.get("/{node}/emergencies", summary="What a node reported", responses=problems(*NODE))
async def list_emergencies(node: NodeDep) -> EmergencyList:
    """The node's last emergencies with cause and remedy, the newest first."""
    return EmergencyList(emergencies=[views.emergency(record) for record in reversed(node.emergencies)])


@commands.post("/boot", summary="Take a node in anew, now")
async def boot(node: NodeDep, tasks: TasksDep) -> NodeReply:
    """Identify, compare, write what differs, read back, start (CiA 302).

    Does what happens by itself as soon as a node appears, for who has put something right and won't wait.
    Resets nothing and enables nothing. While the node is operational every axis must be idle and disabled.
    """
    await tasks.command(node.boot())
    return views.node(node)


@commands.post("/verify-failsafe", summary="See whether a node stops its motors without this service")
async def verify_failsafe(
    node: NodeDep, network: NetworkDep, leases: LeasesDep, tasks: TasksDep, lease: LeaseToken = None
) -> NodeReply:
    """Let the service's heartbeat pause at standstill and look whether the node faults its enabled axes.

    Takes a few seconds. At least one axis of the node must be enabled, and no axis of the bus may move, be in
    use or in somebody else's lease. Afterwards every axis of the bus that was enabled is in FAULT: the pause
    is heard by every module. `failsafe` is `verified` then, until the module's next start; or `off` if it
    went on.
    """
    leases.check(every_axis_of(network), lease)
    await tasks.command(network.verify_failsafe(node.node_id))
    return views.node(node)
