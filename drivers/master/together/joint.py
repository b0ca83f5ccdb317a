"""What several axes do together: it holds them all, and what ends it for one ends it for all.

Each axis carries out its part as an errand of its own, so that everything that can end an errand of one axis
(a stop, a fault, its node's silence) ends its part as ever; the whole hears of it and has the others stopped.
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable, Sequence

from drivers.errors import BadValue, Obstacle
from drivers.master.axis.activity import Guide, Work
from drivers.master.axis.axis import Axis
from drivers.master.axis.commands import AxisCommand
from drivers.master.axis.errands import ErrandName
from drivers.master.axis.readiness import obstacles, refusal
from drivers.master.motions.motion import MotionKind, MotionState, Operation


def require_ready(
    axes: Sequence[Axis], command: AxisCommand, more: tuple[Obstacle, ...] = (), *, absolute: bool = True
) -> None:
    """Raise what `Axis.move_to` would, for the first of the axes that can't take part now.

    `more`: what prevents it besides, where every axis could. Raises `BadValue` for no axes, one that is named
    twice, or several buses.
    """
    if not axes:
        raise BadValue("No axis is named.", hint="Name the axes that take part.")
    if len(set(axes)) != len(axes):
        raise BadValue("An axis is named twice.", hint="Name each axis once.")
    if len({axis.backbone for axis in axes}) != 1:
        raise BadValue("The axes are on different buses.", hint="Only axes of one bus share a SYNC.")
    for axis in axes:
        if found := obstacles(axis, command, absolute=absolute):
            raise refusal(axis, command, found)
    if more:
        raise refusal(axes[0], command, more)


class Joint(Operation):
    """All of it or nothing. Whoever leads it has each axis take its part, and lets it succeed."""

    def __init__(self, kind: MotionKind, axes: Sequence[Axis], operation_id: str | None = None) -> None:
        self._axes = tuple(axes)
        super().__init__(kind, [axis.tools for axis in axes], self._on_change, operation_id)
        self.backbone = axes[0].backbone
        self._publish()

    async def cancel(self) -> None:
        """See `Operation.cancel`; every axis stands then."""
        if not self.done:
            found = await asyncio.gather(
                *(axis.stop("It was cancelled on request.") for axis in self._axes), return_exceptions=True
            )
            for error in found:
                if isinstance(error, BaseException):
                    raise error

    def occupy(self, name: ErrandName, part: Callable[[Axis], Work], guide: Guide | None = None) -> None:
        """Have every axis begin its part, before anything is awaited."""
        for axis in self._axes:
            axis.take_part(self, name, functools.partial(part, axis), guide)

    def _on_change(self, _: Operation) -> None:
        self._publish()
        if self.done and self.state is not MotionState.SUCCEEDED:
            reason = (
                "What it did together with other axes has ended."
                if self.error is None
                else (self.error.message)
            )
            for axis in self._axes:
                if axis.motion is self:
                    axis.begin_stop(reason)

    def _publish(self) -> None:
        first = self._axes[0]
        alone = len(self._axes) == 1
        self.backbone.events.publish(
            "motion",
            node=first.node.node_id,
            axis=first.number if alone else None,
            data={"motion": self},
        )
