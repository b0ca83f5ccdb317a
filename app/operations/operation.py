"""One operation: an operation of the master's, and what the client asked for in its own words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import Any

from app.access.schemas import Asker
from app.axes.units import Scale
from app.axes.views import axis_path, peak
from app.http import problems
from app.http.paths import operation_path
from app.http.schemas import Problem
from app.operations import evidence
from app.operations.schemas import OperationAxis, OperationLinks, OperationReply, OperationState
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import MotionKind, Operation

NOBODY = Asker(name="anonymous", address="")
Results = Mapping[MotionKind, Callable[[Operation, Sequence[Axis]], dict[str, Any]]]
"""How the result of a kind of motion is shown, where that isn't told by its being of one axis."""
PLAIN: Results = {}


class RegisteredOperation:
    """One operation, and what the client asked for in its own words."""

    def __init__(
        self,
        motion: Operation,
        axes: Sequence[Axis],
        request: Mapping[str, Any],
        asked_by: Asker = NOBODY,
        key: str | None = None,
        results: Results = PLAIN,
    ) -> None:
        """`axes`: those whose numbers the motion holds, in its order."""
        self.motion = motion
        self.axes = axes
        self.request = request
        self.asked_by = asked_by
        self.key = key
        """The Idempotency-Key that it came with."""
        self._results = results

    @property
    def id(self) -> str:
        """Unique over all runs of the service."""
        return self.motion.id

    def reply(self) -> OperationReply:
        """What the wire shows of it now."""
        motion = self.motion
        expected = motion.prediction
        error = None
        if motion.error is not None and motion.state.value == OperationState.FAILED:
            error = Problem.model_validate(problems.of_driver_error(motion.error).body)
        asked = asked_for(
            self.id, motion.kind, self.axes, motion.node_id, self.request, self.asked_by, motion.created
        )
        news = {
            "state": OperationState(motion.state.value),
            "progress": motion.progress,
            "predicted_s": None if expected is None else round(expected.duration_s, 4),
            "predicted_peak_velocity": peak(self.axes[0], expected) if len(self.axes) == 1 else None,
            "result": self._result(),
            "error": error,
            "reason": motion.error.message if motion.error is not None else None,
            "evidence": evidence.reply(motion.evidence, self.axes),
            "started": motion.started,
            "ended": motion.ended,
        }
        return asked.model_copy(update=news)

    def _result(self) -> dict[str, Any] | None:
        motion = self.motion
        if motion.result is None:
            return None
        if (shown := self._results.get(motion.kind)) is not None:
            return shown(motion, self.axes)
        return dict(motion.result) if len(self.axes) != 1 else _of_one_axis(self.axes[0], motion.result)


def asked_for(
    operation_id: str,
    kind: MotionKind,
    axes: Sequence[Axis],
    node_id: int | None,
    request: Mapping[str, Any],
    asked_by: Asker,
    created: datetime,
) -> OperationReply:
    """An operation that was just asked for, before anything was sent."""
    only = axes[0] if len(axes) == 1 else None
    path = operation_path(operation_id)
    return OperationReply(
        id=operation_id,
        kind=kind.value,
        node=node_id,
        axis=None if only is None else only.number,
        axes=[OperationAxis(node=a.node.node_id, axis=a.number, name=a.name) for a in axes],
        state=OperationState.QUEUED,
        progress=None,
        request=dict(request),
        result=None,
        error=None,
        reason=None,
        asked_by=asked_by,
        evidence=evidence.nothing(),
        created=created,
        started=None,
        ended=None,
        links=OperationLinks(
            self=path, cancel=f"{path}/cancel", axis=None if only is None else axis_path(only)
        ),
    )


def _of_one_axis(axis: Axis, result: Mapping[str, Any]) -> dict[str, Any]:
    """The result of one axis's motion, with units beside the numbers."""
    scale = Scale.of(axis.config)
    suffixes = {"position": "", "travelled": "", "target": "", "velocity": "/s"}
    return {
        key: scale.quantity(value, suffixes[key]).model_dump()
        if key in suffixes and isinstance(value, int)
        else value
        for key, value in result.items()
    }
