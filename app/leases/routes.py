"""Leases: exclusive control of axes, for a while. Reading and stopping never need one."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Query, Response

from app.http.documentation import AXIS, KEYS, LEASES, UNSAFE, problems
from app.http.finding import NetworkDep, find_axis, find_node
from app.http.parameters import LeaseToken
from app.http.paths import API
from app.http.problems import ApiError
from app.http.routing import Router
from app.http.tasks import Tasks, TasksDep
from app.idempotency.deps import AskerDep, command_headers
from app.leases.deps import LeasesDep
from app.leases.leases import Leases, lease_path
from app.leases.schemas import LeaseBody, LeaseGranted, LeaseList, LeaseReply, ReleaseBody, RenewBody
from drivers.master.axis.axis import Axis
from drivers.master.network import Network

router = Router(f"{API}/leases", tags=["leases"])

LeaseId = Annotated[str, Path(max_length=64, examples=["0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11"])]


@router.post(
    "",
    summary="Take a lease",
    status_code=201,
    dependencies=[Depends(command_headers)],
    responses=problems(*AXIS, *UNSAFE, *KEYS, "leased", "bad_value", "shutting_down"),
)
async def take_lease(
    body: LeaseBody,
    network: NetworkDep,
    leases: LeasesDep,
    tasks: TasksDep,
    asker: AskerDep,
    response: Response,
) -> LeaseGranted:
    """Take exclusive control of axes, all or none: others' commands on them get 423 from now on.

    What runs on them goes on. With `force` the leases that are in the way end, and their axes are stopped; it
    answers at standstill then. A lease that is not renewed in time expires, and its axes are stopped.
    """
    axes = _axes(network, body)
    lease = await tasks.command(
        leases.take(
            axes,
            ttl_s=body.ttl_s,
            owner=body.owner or asker.name,
            holder=asker.name,
            force=body.force,
        )
    )
    response.headers["Location"] = lease_path(lease.id)
    return LeaseGranted(**dict(leases.reply(lease)), token=lease.token)


@router.get("", summary="All leases", responses=problems())
async def list_leases(leases: LeasesDep) -> LeaseList:
    """Who has which axes, and how long still."""
    return LeaseList(leases=[leases.reply(lease) for lease in leases.all()])


@router.get("/{id}", summary="One lease", responses=problems("unknown_lease"))
async def get_lease(id: LeaseId, leases: LeasesDep) -> LeaseReply:  # noqa: A002
    """Who has it, and how long still."""
    return leases.reply(leases.get(id))


@router.post(
    "/{id}/renew",
    summary="Renew a lease",
    dependencies=[Depends(command_headers)],
    responses=problems(*UNSAFE, *KEYS, *LEASES),
)
async def renew_lease(
    id: LeaseId,  # noqa: A002
    leases: LeasesDep,
    token: LeaseToken = None,
    body: RenewBody | None = None,
) -> LeaseReply:
    """Let it last from now on, as long as before or `ttl_s`. Needs its token in the header `Lease`."""
    ttl_s = None if body is None or body.ttl_s is None else body.ttl_s
    return leases.reply(leases.renew(id, token, ttl_s))


@router.post(
    "/{id}/release",
    summary="Release a lease",
    dependencies=[Depends(command_headers)],
    responses=problems(*UNSAFE, *KEYS, *LEASES),
)
async def release_lease(
    id: LeaseId,  # noqa: A002
    leases: LeasesDep,
    tasks: TasksDep,
    token: LeaseToken = None,
    body: ReleaseBody | None = None,
) -> LeaseReply:
    """Give it back. What runs goes on, unless `stop` is set: then it answers at standstill.

    Needs its token in the header `Lease`.
    """
    return await _release(leases, tasks, id, token, stop=body is not None and body.stop)


@router.delete(
    "/{id}",
    summary="Release a lease",
    dependencies=[Depends(command_headers)],
    responses=problems(*UNSAFE, *KEYS, *LEASES),
)
async def delete_lease(
    id: LeaseId,  # noqa: A002
    leases: LeasesDep,
    tasks: TasksDep,
    token: LeaseToken = None,
    stop: Annotated[bool, Query(description="Whether to stop what runs on its axes.")] = False,
) -> LeaseReply:
    """As POST release."""
    return await _release(leases, tasks, id, token, stop=stop)


async def _release(
    leases: Leases, tasks: Tasks, lease_id: str, token: str | None, *, stop: bool
) -> LeaseReply:
    lease = await tasks.unconditional(leases.release(lease_id, token, stop=stop))
    return leases.reply(lease)


def _axes(network: Network, body: LeaseBody) -> list[Axis]:
    """The axes that are asked for. Raises `UnknownNode`, `UnknownAxis`, `ApiError` (422)."""
    if (body.axes is None) is (body.node is None):
        raise ApiError("bad_value", "Either axes or a node must be given.", hint="Give one of them.")
    if body.node is not None:
        return list(find_node(network, body.node).axes)
    return [find_axis(network, each.node, each.axis) for each in body.axes or ()]
