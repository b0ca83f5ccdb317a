"""Operations: the master's motions, with ids and links, remembered for a while after they ended.

The register holds what runs without bound (the axes bound it: one each) and at most `KEPT` that ended.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from app import problems
from app.problems import ApiError
from app.schemas.common import Problem
from app.schemas.operations import OperationLinks, OperationReply, OperationState
from app.units import Scale
from app.views import axis_path
from drivers.master.motion import Motion, MotionKind

KEPT = 1000
"""How many ended operations are remembered."""


def operation_path(operation_id: str) -> str:
    """Where the operation is."""
    return f"/api/v1/operations/{operation_id}"


class Operation:
    """One motion, and what the client asked for in its own words."""

    def __init__(self, motion: Motion, request: Mapping[str, Any]) -> None:
        self.motion = motion
        self.request = request

    @property
    def id(self) -> str:
        """Unique over all runs of the service."""
        return self.motion.id

    def reply(self) -> OperationReply:
        """What the wire shows of it now."""
        motion = self.motion
        axis = motion.axis
        path = operation_path(self.id)
        error = None
        if motion.error is not None and motion.state.value == OperationState.FAILED:
            error = Problem.model_validate(problems.of_driver_error(motion.error).body)
        return OperationReply(
            id=self.id,
            kind=motion.kind.value,
            node=axis.node.node_id,
            axis=axis.number,
            state=OperationState(motion.state.value),
            progress=motion.progress,
            request=dict(self.request),
            result=_result(motion),
            error=error,
            reason=motion.error.message if motion.error is not None else None,
            created=motion.created,
            started=motion.started,
            ended=motion.ended,
            links=OperationLinks(
                self=path,
                cancel=f"{path}/cancel",
                axis=axis_path(axis),
            ),
        )


def _result(motion: Motion) -> dict[str, Any] | None:
    """The motion's result with units beside its numbers."""
    if motion.result is None:
        return None
    scale = Scale.of(motion.axis.config)
    suffixes = {"position": "", "target": "", "velocity": "/s"}
    return {
        key: scale.quantity(value, suffixes[key]).model_dump()
        if key in suffixes and isinstance(value, int)
        else value
        for key, value in motion.result.items()
    }


class OperationRegister:
    """All operations by id, oldest first."""

    def __init__(self, kept: int = KEPT) -> None:
        self._kept = kept
        self._by_id: OrderedDict[str, Operation] = OrderedDict()
        self.started: dict[MotionKind, int] = dict.fromkeys(MotionKind, 0)
        """How many of each kind were ever started."""

    def add(self, motion: Motion, request: Mapping[str, Any]) -> Operation:
        """Remember a motion that was just started, and forget the oldest that ended."""
        operation = Operation(motion, request)
        self._by_id[operation.id] = operation
        self.started[motion.kind] += 1
        if len(self._by_id) > self._kept:
            ended = next((o.id for o in self._by_id.values() if o.motion.done), None)
            if ended is not None:
                del self._by_id[ended]
        return operation

    def get(self, operation_id: str) -> Operation:
        """The operation of that id. Raises `ApiError` (404)."""
        operation = self._by_id.get(operation_id)
        if operation is None:
            raise ApiError("unknown_operation", f"There is no operation {operation_id[:64]!r}.")
        return operation

    def reply_for(self, motion: Motion) -> OperationReply:
        """What the wire shows of a motion, whoever began it."""
        return self._by_id.get(motion.id, Operation(motion, {})).reply()

    def newest(self, limit: int) -> list[Operation]:
        """The newest `limit` operations, the newest first."""
        return [operation for operation, _ in zip(reversed(self._by_id.values()), range(limit), strict=False)]
