"""What the routes are given: the service, and nodes and axes by what a path calls them."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import Depends, Header, Path, Query, Request

from app.problems import ApiError
from app.schemas.common import NoBody
from app.service import Service
from drivers.master.axis import Axis
from drivers.master.node import Node

LONGEST_WAIT = 600.0
_PREFER_WAIT = re.compile(r'(?:^|[,;])\s*wait\s*=\s*"?(\d{1,9})"?\s*(?=$|[,;])', re.IGNORECASE)


async def get_service(request: Request) -> Service:
    """The running service."""
    service: Service = request.state.service
    return service


ServiceDep = Annotated[Service, Depends(get_service)]

NodeRef = Annotated[
    str, Path(description="Node ID, or the node's name.", max_length=64, examples=["1"], min_length=1)
]
AxisRef = Annotated[
    str, Path(description="Axis number, or the axis's name.", max_length=64, examples=["0"], min_length=1)
]


def _reference(text: str) -> int | str:
    return int(text) if text.isascii() and text.isdecimal() else text


async def get_node(request: Request, node: NodeRef) -> Node:
    """The node that the path names. Raises `UnknownNode`."""
    service: Service = request.state.service
    return service.network.node(_reference(node))


NodeDep = Annotated[Node, Depends(get_node)]


async def get_axis(request: Request, node: NodeRef, axis: AxisRef) -> Axis:
    """The axis that the path names. Raises `UnknownNode`, `UnknownAxis`.

    It depends on no other dependency: each level costs a hot path more than the look-up itself.
    """
    return (await get_node(request, node)).axis(_reference(axis))


AxisDep = Annotated[Axis, Depends(get_axis)]


class Wait:
    """How long a client is ready to wait for the end of an operation."""

    def __init__(self, seconds: float, preferred: bool) -> None:
        self.seconds = seconds
        self.preferred = preferred
        """Whether it came from the Prefer header, which wants to hear that it was applied."""


async def get_wait(
    wait: Annotated[
        float | None,
        Query(ge=0, le=LONGEST_WAIT, allow_inf_nan=False, description="Seconds to wait for the end."),
    ] = None,
    prefer: Annotated[
        str | None, Header(description="`wait=SECONDS` (RFC 7240), like the query.", max_length=200)
    ] = None,
) -> Wait:
    """From the query, else from the Prefer header; a preference that can't be met is ignored (RFC 7240)."""
    if wait is not None:
        return Wait(wait, preferred=False)
    found = _PREFER_WAIT.search(prefer or "")
    if found is None:
        return Wait(0.0, preferred=False)
    return Wait(min(LONGEST_WAIT, float(found[1])), preferred=True)


WaitDep = Annotated[Wait, Depends(get_wait)]

IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=255,
        description="A command that is sent again with the same key is not carried out again.",
    ),
]


async def command_headers(idempotency_key: IdempotencyKey = None) -> None:
    """Documents the header; the middleware acts on it."""
    del idempotency_key


async def empty_body(body: NoBody | None = None) -> None:
    """Documents that a command without parameters takes an empty object: so clients send its content type."""
    del body


def parse_index(text: str) -> int:
    """An object index in hexadecimal. Raises `ApiError` (422)."""
    if re.fullmatch(r"0[xX][0-9A-Fa-f]{1,4}", text) is None:
        raise ApiError(
            "bad_value", "The object index is written in hexadecimal with 0x.", hint="For example 0x6064."
        )
    return int(text, 16)
