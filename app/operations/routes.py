"""Operations: looking at them, and ending them."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Query

from app.http.documentation import AXIS_COMMAND, problems
from app.http.parameters import empty_body
from app.http.paths import API
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.http.waiting import WaitDep
from app.idempotency.deps import command_headers
from app.operations.deps import OperationsDep
from app.operations.schemas import OperationList, OperationReply, OperationState

router = Router(f"{API}/operations", tags=["operations"])

OperationId = Annotated[str, Path(max_length=64, examples=["6f1c2a7b9d3e4f50"])]


@router.get(
    "", summary="Operations, the newest first", responses=problems("unknown_operation", "history_off")
)
async def list_operations(
    operations: OperationsDep,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    state: Annotated[OperationState | None, Query(description="Only those in this state.")] = None,
    before: Annotated[
        str | None, Query(max_length=64, description="Only those created before this one: for the next page.")
    ] = None,
) -> OperationList:
    """What was commanded, and how it ended, over restarts of the service. The oldest are forgotten."""
    return OperationList(operations=await operations.newest(limit, state=state, before=before))


@router.get("/{id}", summary="One operation", responses=problems("unknown_operation", "history_off"))
async def get_operation(id: OperationId, operations: OperationsDep, wait: WaitDep) -> OperationReply:  # noqa: A002
    """How far it is. With `wait` the answer comes when it ended, at the latest after that time."""
    live = operations.live(id)
    if live is not None:
        await wait.until_end(live.motion)
    return await operations.get(id)


@router.post(
    "/{id}/cancel",
    summary="End an operation",
    dependencies=[Depends(command_headers), Depends(empty_body)],
    responses=problems("unknown_operation", "history_off", *AXIS_COMMAND),
)
async def cancel_operation(id: OperationId, operations: OperationsDep, tasks: TasksDep) -> OperationReply:  # noqa: A002
    """Controlled stop of what it moves; answers at standstill. Does nothing if it ended already."""
    live = operations.live(id)
    if live is not None:
        await tasks.unconditional(live.motion.cancel())
    return await operations.get(id)
