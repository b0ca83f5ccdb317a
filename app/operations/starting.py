"""What every command that takes time has in common: written down, begun, waited for, answered."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

from fastapi import Depends, Request, Response

from app.http.paths import operation_path
from app.http.tasks import TASKS, Tasks
from app.http.waiting import Wait, WaitDep
from app.idempotency.deps import AskerDep, CommandSource
from app.leases.deps import LEASES
from app.leases.leases import Leases
from app.operations.deps import OPERATIONS
from app.operations.register import OperationRegister
from app.operations.schemas import OperationReply
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import MotionKind, Operation
from drivers.master.node.node import Node


class Starter:
    """Starts the operation of one request."""

    def __init__(
        self,
        operations: OperationRegister,
        leases: Leases,
        tasks: Tasks,
        *,
        asker: CommandSource,
        wait: Wait,
        response: Response,
    ) -> None:
        self._operations = operations
        self._leases = leases
        self._tasks = tasks
        self._asker = asker
        self._wait = wait
        self._response = response

    async def start(
        self,
        kind: MotionKind,
        axes: Axis | Node | Sequence[Axis],
        asked: Mapping[str, Any],
        begin: Callable[[str], Operation],
    ) -> OperationReply:
        """Begin what `begin` makes of the operation's id, and wait as long as the client wants.

        It is about one axis, several, or a node as such. Raises what `begin` raises, and `ApiError` (423) if
        an axis is somebody else's; then nothing was sent, and no operation is left behind.
        """
        taking_part = _axes(axes)
        check = self._leases.check
        check(taking_part, self._asker.lease)

        def begin_if_still_held(operation_id: str) -> Operation:
            check(taking_part, self._asker.lease)  # it may have ended while the record was written
            return begin(operation_id)

        operation = await self._tasks.command(
            self._operations.start(
                kind,
                taking_part,
                asked,
                begin_if_still_held,
                node=axes if isinstance(axes, Node) else None,
                asked_by=self._asker.reply,
                claim=self._asker.claim,
            )
        )
        ended = await self._wait.until_end(operation.motion)
        self._response.headers["Location"] = operation_path(operation.id)
        self._response.status_code = 200 if ended else 202
        if self._wait.preferred:
            self._response.headers["Preference-Applied"] = f"wait={self._wait.seconds:g}"
        return operation.reply()

    def holds(self, axis: Axis) -> bool:
        """Whether the request is sent under the lease that an axis is in."""
        lease = self._leases.of(axis)
        return lease is not None and lease.token == self._asker.lease


def _axes(axes: Axis | Node | Sequence[Axis]) -> tuple[Axis, ...]:
    if isinstance(axes, Node):
        return ()
    return (axes,) if isinstance(axes, Axis) else tuple(axes)


async def get_starter(request: Request, asker: AskerDep, wait: WaitDep, response: Response) -> Starter:
    """A starter for this request. A coroutine, since FastAPI makes anything else in a thread."""
    scope = request.scope
    return Starter(
        OPERATIONS.of(scope), LEASES.of(scope), TASKS.of(scope), asker=asker, wait=wait, response=response
    )


StarterDep = Annotated[Starter, Depends(get_starter)]
