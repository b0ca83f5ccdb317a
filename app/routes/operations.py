"""Operations: looking at them, and ending them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query

from app.deps import ServiceDep, WaitDep, command_headers, empty_body
from app.documentation import AXIS_COMMAND, problems
from app.schemas.operations import OperationList, OperationReply, OperationState

router = APIRouter(prefix="/operations", tags=["operations"])

OperationId = Annotated[str, Path(max_length=64, examples=["6f1c2a7b9d3e4f50"])]


@router.get("", summary="Operations, the newest first", responses=problems())
async def list_operations(
    service: ServiceDep,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    state: Annotated[OperationState | None, Query(description="Only those in this state.")] = None,
) -> OperationList:
    """What was commanded, and how it ended. The oldest that ended are forgotten some time."""
    found = (operation.reply() for operation in service.operations.newest(1000))
    chosen = [reply for reply in found if state is None or reply.state is state]
    return OperationList(operations=chosen[:limit])


@router.get("/{id}", summary="One operation", responses=problems("unknown_operation"))
async def get_operation(id: OperationId, service: ServiceDep, wait: WaitDep) -> OperationReply:  # noqa: A002
    """How far it is. With `wait` the answer comes when it ended, at the latest after that time."""
    operation = service.operations.get(id)
    await wait.until_end(operation.motion)
    return operation.reply()


@router.post(
    "/{id}/cancel",
    summary="End an operation",
    dependencies=[Depends(command_headers), Depends(empty_body)],
    responses=problems("unknown_operation", *AXIS_COMMAND),
)
async def cancel_operation(id: OperationId, service: ServiceDep) -> OperationReply:  # noqa: A002
    """Controlled stop of what it moves; answers at standstill. Does nothing if it ended already."""
    operation = service.operations.get(id)
    await service.unconditional(operation.motion.cancel())
    return operation.reply()
