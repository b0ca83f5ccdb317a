"""Requests about an axis that need no parsing, answered past FastAPI's dependency injection.

FastAPI resolves parameters and validates our own reply anew for each request. That costs ten times what
looking at an axis does; a stop waits for it, and a polled status is asked a thousand times a second.
"""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable
from typing import Any, cast

from fastapi.routing import APIRoute
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.access.roles import needs_lease
from app.axes.deps import get_axis
from app.http.finding import LONGEST_REFERENCE, NETWORK, find_axis
from app.http.parameters import KEY, LEASE, empty_body
from app.http.parts import Part, part_of
from app.http.schemas import Reply
from app.idempotency.deps import command_headers
from app.leases.deps import LEASES

_NEEDS_CARE = frozenset({KEY.encode(), b"transfer-encoding"})
_DEPENDENCIES = frozenset({get_axis, command_headers, empty_body})
"""That of the argument, and those that have nothing to look at in a plain request."""


class AxisRoute(APIRoute):
    """A route to an endpoint that takes nothing but the axis of its path, and parts of the service.

    The endpoint's annotations document it as ever. A request that says more, by a body or an idempotency key,
    goes FastAPI's way. Raises `TypeError` for an endpoint or a dependency that would be passed over.
    """

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        super().__init__(path, endpoint, **options)
        self._parts: dict[str, Part[object]] = {}
        """By the names of the arguments."""
        unserved: set[object] = {name for name in inspect.signature(endpoint).parameters if name != "axis"}
        for dependency in self.dependant.dependencies:
            part = part_of(dependency.call)
            if part is not None and dependency.name is not None:
                self._parts[dependency.name] = part
                unserved.discard(dependency.name)
            elif dependency.call not in _DEPENDENCIES:
                unserved.add(dependency.call)
        if unserved:
            raise TypeError(f"{path}: nobody would see to {unserved}")
        self._needs_lease = any(needs_lease(method, path) for method in self.methods or ())

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a plain request; hand FastAPI what is to be parsed or refused."""
        if scope["method"] not in (self.methods or ()) or not _is_plain(scope):
            await super().handle(scope, receive, send)
            return
        axis = find_axis(NETWORK.of(scope), **scope["path_params"])
        if self._needs_lease:
            LEASES.of(scope).check((axis,), _lease_token(scope))
        parts = {name: part.of(scope) for name, part in self._parts.items()}
        reply = await cast("Callable[..., Awaitable[Reply]]", self.endpoint)(axis=axis, **parts)
        response = Response(reply.model_dump_json(by_alias=True), media_type="application/json")
        await response(scope, receive, send)


def _lease_token(scope: Scope) -> str | None:
    return next((value.decode("latin-1") for name, value in scope["headers"] if name == LEASE.encode()), None)


def _is_plain(scope: Scope) -> bool:
    headers: list[tuple[bytes, bytes]] = scope["headers"]
    for name, value in headers:
        if name in _NEEDS_CARE or (name == b"content-length" and value != b"0"):
            return False
    references: dict[str, str] = scope["path_params"]
    return all(len(reference) <= LONGEST_REFERENCE for reference in references.values())
