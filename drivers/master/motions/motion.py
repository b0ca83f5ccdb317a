"""What takes time on one axis or several: what was asked, how far it got, how it ended.

Whoever drives it also ends it: an axis its motions, a group of axes what they do together. So a motion holds
the numbers of its axes, not the axes: what it needs of them is given to it.
"""

from __future__ import annotations

import asyncio
import enum
import uuid
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Mapping, Sequence
from datetime import UTC, datetime

from drivers.errors import CanaxisError
from drivers.master.drive.tools import AxisTools
from drivers.master.plan.prediction import Prediction
from drivers.master.plan.requests import Request
from drivers.master.seen.evidence import Evidence


class MotionKind(enum.StrEnum):
    """What sort of motion."""

    MOVE = "move"
    VELOCITY = "velocity"
    HOME = "home"
    SET_POSITION = "set_position"
    JOG = "jog"
    COORDINATED_MOVE = "coordinated_move"
    WAIT_INPUT = "wait_input"
    """Moves nothing, and holds no axis."""
    TRAJECTORY = "trajectory"


class MotionState(enum.StrEnum):
    """How far a motion is; the last three are ends and never change again."""

    QUEUED = "queued"
    """Accepted: it waits for what comes before it, or parameters are being written."""
    RUNNING = "running"
    """The drive was told to begin."""
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    """`Motion.error` says why."""
    CANCELLED = "cancelled"
    """A stop, a disable or another command ended it; `Motion.error` says which. The axis may still be ramping
    down for a moment: `Motion.cancel` and `Axis.stop` return at standstill."""

    @property
    def ended(self) -> bool:
        """Whether it is one of the ends."""
        return self in (MotionState.SUCCEEDED, MotionState.FAILED, MotionState.CANCELLED)


Result = Mapping[str, int | float | bool | str | Sequence[Mapping[str, int | float | str | None]]]
"""`position` in steps, and for a move its absolute `target`, for a turning its `velocity`, for a homing
`method`; for a jog how far it `travelled` and how it was held.
"""


class MotionCancelled(CanaxisError):
    """Why a motion was cancelled."""

    code = "motion_cancelled"


class Operation(ABC):
    """Awaitable and cancellable. It belongs to the axes, not to the client that asked for it."""

    noun = "motion"
    """What it is called where it is told that it was cancelled."""

    def __init__(
        self,
        kind: MotionKind,
        axes: Sequence[AxisTools],
        on_change: Callable[[Operation], None],
        operation_id: str | None = None,
        *,
        node_id: int | None = None,
    ) -> None:
        """`operation_id`: where it was written down before it began; None: a new one.

        `node_id` is what it belongs to where it has no axes.
        """
        self.id = operation_id or uuid.uuid4().hex
        self.kind = kind
        self.axes = tuple(axis.id for axis in axes)
        self.node_id = axes[0].node_id if len(axes) == 1 else node_id
        """The one node, where it is about one axis or a node as such; else None."""
        self.state = MotionState.QUEUED
        self.progress: float | None = None
        """0..1, or None where it can't be known."""
        self.prediction: Prediction | None = None
        """What it should come to, without what it has to wait for; None while that can't be known."""
        self.result: Result | None = None
        """What it came to, if it succeeded; of a trajectory also what was measured of one that did not."""
        self.error: CanaxisError | None = None
        self.created = datetime.now(UTC)
        self.started: datetime | None = None
        self.ended: datetime | None = None
        self._drives = {axis.id: axis.drive for axis in axes}
        self.evidence = self._begin_evidence()
        self._listeners = [on_change]
        self._end = asyncio.Event()

    @property
    def done(self) -> bool:
        """Whether it has ended, one way or another."""
        return self.state.ended

    async def wait(self, timeout: float | None = None) -> bool:  # noqa: ASYNC109 - it never raises
        """Wait at most `timeout` seconds for the end; True if it has ended."""
        try:
            async with asyncio.timeout(timeout):
                await self._end.wait()
        except TimeoutError:
            return self.done
        return True

    @abstractmethod
    async def cancel(self) -> None:
        """End it with a controlled stop and return at standstill; nothing happens if it has ended.

        Raises what `Axis.stop` raises.
        """

    def watch(self, listener: Callable[[Operation], None]) -> None:
        """Have `listener` called, synchronously, whenever the state changes from now on."""
        self._listeners.append(listener)

    # The rest is for whoever drives it.

    def begin(self) -> None:
        """The drive is being told."""
        if self.state is MotionState.QUEUED:
            self.state = MotionState.RUNNING
            self.started = datetime.now(UTC)
            self._tell()

    def has_its_turn(self) -> None:
        """It waited for others until now: its evidence is about what happens from here."""
        self.evidence = self._begin_evidence()

    def succeed(self, result: Result) -> None:
        """It reached its end."""
        self.result = result
        self.progress = 1.0
        self._finish(MotionState.SUCCEEDED, None)

    def fail(self, error: CanaxisError) -> None:
        """It did not reach its end."""
        self._finish(MotionState.FAILED, error)

    def give_up(self, reason: str) -> None:
        """Something else ended it, on purpose."""
        one = self.axes[0] if len(self.axes) == 1 else None
        error = MotionCancelled(
            f"The {self.noun} was cancelled: {reason}",
            hint="Start it again if it is still wanted.",
            node=self.node_id,
            axis=None if one is None else one.number,
        )
        self._finish(MotionState.CANCELLED, error)

    def _finish(self, state: MotionState, error: CanaxisError | None) -> None:
        if self.done:
            return
        self.state = state
        self.error = error
        self.ended = datetime.now(UTC)
        self.evidence.end()
        self._end.set()
        self._tell()

    def _begin_evidence(self) -> Evidence:
        return Evidence(lambda: {axis: drive.status for axis, drive in self._drives.items()})

    def _tell(self) -> None:
        for listener in self._listeners:
            listener(self)


class Motion(Operation):
    """What one axis does for one command."""

    def __init__(
        self,
        kind: MotionKind,
        axis: AxisTools,
        request: Request,
        on_change: Callable[[Operation], None],
        stop: Callable[[Motion, str], Awaitable[None]],
        operation_id: str | None = None,
    ) -> None:
        """`stop` ends it for a reason, at whatever point it is, and returns at standstill; raises what
        `Axis.stop` raises.
        """
        super().__init__(kind, (axis,), on_change, operation_id)
        self.axis = axis.id
        self.request = request
        self._stop = stop

    async def cancel(self) -> None:
        """See `Operation.cancel`."""
        if not self.done:
            await self._stop(self, "It was cancelled on request.")
