"""The parts of the service, by the names under which the lifespan hands them to every request.

Each feature names its own, with its type, in its `deps`; nobody is handed the whole service.
"""

from __future__ import annotations

from typing import Generic, TypeVar, cast

from starlette.requests import HTTPConnection
from starlette.types import Scope

T = TypeVar("T")


class Part(Generic[T]):
    """A part of the service: ``LEASES: Part[Leases] = Part("leases")``.

    A route asks for it with ``Annotated[Leases, Depends(LEASES.get)]``, what has a scope with ``LEASES.of``.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def of(self, scope: Scope) -> T:
        """The part, for a request or a WebSocket."""
        return cast("T", scope["state"][self.name])

    def of_any(self, scope: Scope) -> T | None:
        """The same where there may be none: in an application without our lifespan."""
        return cast("T | None", scope.get("state", {}).get(self.name))

    async def get(self, connection: HTTPConnection) -> T:
        """The part, as a dependency of FastAPI, which would call anything but a coroutine in a thread."""
        return self.of(connection.scope)


def part_of(dependency: object) -> Part[object] | None:
    """The part that a dependency gets; None if it gets something else."""
    owner: object = getattr(dependency, "__self__", None)
    return cast("Part[object]", owner) if isinstance(owner, Part) else None
