"""What the routes are given: the service, and nodes and axes by what a path calls them."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Header, Path, Query, Request

from app.access.roles import is_dry_run, needs_lease
from app.access.schemas import Asker
from app.access.tokens import Principal
from app.http.problems import ApiError
from app.http.schemas import NoBody
from app.idempotency.keys import Claim
from app.leases.book import LEASE
from app.service import Service
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import Undertaking
from drivers.master.node.node import Node

LONGEST_WAIT = 600.0
LONGEST_REFERENCE = 64
"""Characters of what a path calls a node or an axis."""
_PREFER_WAIT = re.compile(r'(?:^|[,;])\s*wait\s*=\s*"?(\d{1,9})"?\s*(?=$|[,;])', re.IGNORECASE)


async def get_service(request: Request) -> Service:
    """The running service."""
    service: Service = request.state.service
    return service


ServiceDep = Annotated[Service, Depends(get_service)]

NodeRef = Annotated[
    str,
    Path(
        description="Node ID, or the node's name.", max_length=LONGEST_REFERENCE, examples=["1"], min_length=1
    ),
]
AxisRef = Annotated[
    str,
    Path(
        description="Axis number, or the axis's name.",
        max_length=LONGEST_REFERENCE,
        examples=["0"],
        min_length=1,
    ),
]


def reference(given: int | str) -> int | str:
    """What a node or an axis is called: digits are its number, also as text."""
    return int(given) if isinstance(given, str) and given.isascii() and given.isdecimal() else given


def find_axis(service: Service, node: str, axis: str) -> Axis:
    """The axis that a path names. Raises `UnknownNode`, `UnknownAxis`."""
    return service.network.node(reference(node)).axis(reference(axis))


async def get_node(request: Request, node: NodeRef) -> Node:
    """The node that the path names; for a command, none of its axes may be somebody else's.

    Raises `UnknownNode`, `ApiError` (423).
    """
    service: Service = request.state.service
    found = service.network.node(reference(node))
    if _is_command(request):
        service.leases.check(found.axes, request.headers.get(LEASE))
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
    service: Service = request.state.service
    found = find_axis(service, node, axis)
    if _is_command(request):
        service.leases.check((found,), request.headers.get(LEASE))
    return found


AxisDep = Annotated[Axis, Depends(get_axis)]


class Wait:
    """How long a client is ready to wait for the end of an operation."""

    def __init__(self, request: Request, seconds: float, *, preferred: bool = False) -> None:
        self.seconds = seconds
        self.preferred = preferred
        """Whether it came from the Prefer header, which wants to hear that it was applied."""
        self._request = request

    async def until_end(self, motion: Undertaking) -> bool:
        """Wait for a motion, as long as the client wants and is there; True if it ended.

        The motion goes on without the client, but its Idempotency-Key must not stay in flight.
        """
        if self.seconds <= 0:
            return motion.done
        end = asyncio.ensure_future(motion.wait(self.seconds))
        gone = asyncio.ensure_future(self._gone())
        try:
            await asyncio.wait((end, gone), return_when=asyncio.FIRST_COMPLETED)
        finally:
            end.cancel()
            gone.cancel()
            await asyncio.gather(end, gone, return_exceptions=True)
        return motion.done

    async def _gone(self) -> None:
        while (await self._request.receive())["type"] != "http.disconnect":
            pass  # the body of a GET


async def get_wait(
    request: Request,
    wait: Annotated[
        float | None,
        Query(ge=0, le=LONGEST_WAIT, allow_inf_nan=False, description="Seconds to wait for the end."),
    ] = None,
    prefer: Annotated[
        str | None,
        Header(description="`wait=SECONDS` (RFC 7240), like the query; ignored if it is anything else."),
    ] = None,
) -> Wait:
    """From the query, else from the Prefer header; a preference that can't be met is ignored (RFC 7240)."""
    if wait is not None:
        return Wait(request, wait)
    found = _PREFER_WAIT.search(prefer or "")
    if found is None:
        return Wait(request, 0.0)
    return Wait(request, min(LONGEST_WAIT, float(found[1])), preferred=True)


WaitDep = Annotated[Wait, Depends(get_wait)]

IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=255,
        description=(
            "Any text of your own, new with each new command. A command that is sent again with the same "
            "key, path, query and body is not carried out again: it gets the first answer again, with "
            "`Idempotent-Replayed: true`. With anything else it gets 422, and while the first is in flight "
            "409. A command that was refused (4xx, 503) leaves its key free. Keys are kept for 24 hours, "
            "over restarts of the service too, and each token has keys of its own."
        ),
    ),
]


LeaseToken = Annotated[
    str | None,
    Header(
        alias="Lease",
        max_length=255,
        description=(
            "The token of the lease under which it is sent. Without it, an axis of a lease takes no command: "
            "423 `leased`. With one that expired, was released or taken over: 423 `lease_lost`, even if the "
            "axis is free."
        ),
    ),
]


@dataclass(frozen=True, slots=True)
class CommandSource:
    """Who sent a command, and under which key."""

    name: str
    address: str
    claim: Claim | None
    """The Idempotency-Key that is to be spent with it."""
    lease: str | None
    """The token of the lease under which it was sent."""

    @property
    def reply(self) -> Asker:
        """As an operation shows it."""
        return Asker(name=self.name, address=self.address)


async def get_asker(
    request: Request, idempotency_key: IdempotencyKey = None, lease: LeaseToken = None
) -> CommandSource:
    """Who asks, as far as the middlewares know."""
    del idempotency_key  # documented here; what counts is the claim
    principal: Principal = request.state.principal
    address = "" if request.client is None else request.client.host
    return CommandSource(principal.name, address, _claim(request), lease)


AskerDep = Annotated[CommandSource, Depends(get_asker)]


def _claim(request: Request) -> Claim | None:
    return getattr(request.state, "claim", None)


async def command_headers(
    request: Request, idempotency_key: IdempotencyKey = None, lease: LeaseToken = None
) -> None:
    """For a command that begins no operation: its key is spent before it is carried out.

    One that begins an operation has its key written down with that (`Starter`), and must not have this.
    """
    del idempotency_key, lease  # documented here; what counts is the claim, and who looks for node or axis
    if (claim := _claim(request)) is not None:
        await claim.write_down()


async def every_axis(request: Request) -> None:
    """For a command that may concern every axis there is: none may be somebody else's.

    Raises `ApiError` (423).
    """
    service: Service = request.state.service
    axes = [axis for node in service.network.nodes.values() for axis in node.axes]
    service.leases.check(axes, request.headers.get(LEASE))


async def empty_body(body: NoBody | None = None) -> None:
    """Documents that a command without parameters takes an empty object: so clients send its content type."""
    del body


DryRun = Annotated[
    bool,
    Query(
        description="Only say what the command would come to: nothing is sent, no operation is made, no "
        "Idempotency-Key is spent, no lease is needed. A disabled axis will do.",
    ),
]


def parse_index(text: str) -> int:
    """An object index in hexadecimal. Raises `ApiError` (422)."""
    if re.fullmatch(r"0[xX][0-9A-Fa-f]{1,4}", text) is None:
        raise ApiError(
            "bad_value", "The object index is written in hexadecimal with 0x.", hint="For example 0x6064."
        )
    return int(text, 16)
