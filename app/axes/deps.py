"""The node or the axis of a path; for a command, none that is somebody else's."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from app.access.roles import is_dry_run, needs_lease
from app.http.finding import NETWORK, AxisRef, NodeRef, every_axis_of, find_axis, find_node
from app.http.parameters import LEASE
from app.leases.deps import LEASES
from drivers.master.axis.axis import Axis
from drivers.master.node.node import Node


async def get_node(request: Request, node: NodeRef) -> Node:
    """The node that the path names; for a command, none of its axes may be somebody else's.

    Raises `UnknownNode`, `ApiError` (423).
    """
    found = find_node(NETWORK.of(request.scope), node)
    if _is_command(request):
        LEASES.of(request.scope).check(found.axes, request.headers.get(LEASE))
    return found


def _is_command(request: Request) -> bool:
    """Whether others' leases forbid it: a look before moving they don't."""
    template: str = request.scope["route"].path
    if not needs_lease(request.method, template):
        return False
    return not is_dry_run(template, request.query_params.get("dry_run"))


NodeDep = Annotated[Node, Depends(get_node)]


async def get_axis(request: Request, node: NodeRef, axis: AxisRef) -> Axis:
    """The axis that the path names; for a command, it may not be somebody else's.

    Raises `UnknownNode`, `UnknownAxis`, `ApiError` (423).
    """
    found = find_axis(NETWORK.of(request.scope), node, axis)
    if _is_command(request):
        LEASES.of(request.scope).check((found,), request.headers.get(LEASE))
    return found


AxisDep = Annotated[Axis, Depends(get_axis)]


async def every_axis(request: Request) -> None:
    """For a command that may concern every axis there is: none may be somebody else's.

    Raises `ApiError` (423).
    """
    axes = every_axis_of(NETWORK.of(request.scope))
    LEASES.of(request.scope).check(axes, request.headers.get(LEASE))
