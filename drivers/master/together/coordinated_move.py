"""Several axes of a bus that start on one SYNC and arrive together: all of them, or none goes on.

Parameters and mode are written and confirmed first. Then each target goes out by the axis's synchronous
RPDO 4 with bit 4 low, a SYNC has the modules take it, and 607Ah is read back: so targets, RPDOs and SYNC are
seen to arrive before anything can move. Then bit 4 goes out the same way, an answer of every node shows that
it has it, and one SYNC starts them all. An axis that doesn't show within `Timing.group_start` that it
started has them all stopped, as has whatever ends the part of any of them.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Iterable, Sequence

from drivers.errors import AxisFault, CanaxisError, MotionFailed, MotionTimeout
from drivers.master.axis.axis import Axis
from drivers.master.axis.errands import ErrandName
from drivers.master.drive.drive import Condition
from drivers.master.motions.motion import MotionCancelled, MotionKind, MotionState, Operation, Result
from drivers.master.plan.requests import MoveRequest
from drivers.master.seen.status import AxisStatus
from drivers.master.together.coordinated_prediction import expected, planned
from drivers.master.together.coordination import Coordination
from drivers.master.together.hindrances import SYNC_USER, merged, require_ready
from drivers.master.together.member import Member

_TURN = 0.002
_EMERGENCY_WAIT = 0.1
"""How long the emergency that explains a FAULT may come after the statusword."""


class CoordinatedMove(Operation):
    """A coordinated move. Its end is told when every axis stands, as far as they can be reached."""

    def __init__(
        self,
        moves: Sequence[tuple[Axis, MoveRequest]],
        *,
        at_least: float = 0.0,
        replace: bool = False,
        operation_id: str | None = None,
    ) -> None:
        """Check everything, occupy every axis and begin; nothing was sent if it raises.

        `at_least`: seconds that it is to take; `replace`: stop first what axes are doing. Raises `BadValue`,
        `NotReady`, `AxisBusy`, `StopLatched`, `NodeAway` or `BusDown`, for all axes at once.
        """
        self.members = tuple(Member(axis, request) for axis, request in moves)
        require_ready(self.members, replace=replace)
        self._axes = axes = tuple(member.axis for member in self.members)
        first = planned(self.members, at_least)
        tools = [axis.tools for axis in axes]
        super().__init__(MotionKind.COORDINATED_MOVE, tools, self._publish, operation_id)
        self.prediction = expected(first, self.members)
        self.coordination: Coordination | None = None
        """The common time, once it is known from where the axes stand."""
        self._backbone = axes[0].backbone
        self._at_least = at_least
        self._has_sync = False
        """Whether it is this group that starts by the SYNC now: another may have it under the same name."""
        self._verdict: tuple[MotionState, CanaxisError] | None = None
        self._over = asyncio.Event()
        self._lives = False
        """Whether the task has begun: one that is cancelled before never tells an end."""
        self._started_at = 0.0
        self._longest: Member | None = None
        self._publish(self)
        replaced = [axis for axis in axes if axis.errand is not None or axis.status.moving]
        for axis in axes:
            if axis in replaced:
                axis.begin_stop("A coordinated move replaced it.")
                axis.expect(self)
            else:
                axis.take_part(self, ErrandName.MOVING, self._hold)
        self._task = asyncio.create_task(self._live(replaced), name=f"coordinated move {self.id}")

    # --- ending ---

    async def cancel(self) -> None:
        """See `Operation.cancel`; every axis stands then."""
        if self.done:
            return
        self._abort(MotionState.CANCELLED, _cancelled("It was cancelled on request."))
        found = await asyncio.gather(*(axis.stands() for axis in self._axes), return_exceptions=True)
        await self.wait()
        for error in found:
            if isinstance(error, BaseException):
                raise error

    def give_up(self, reason: str) -> None:
        """One of the axes was stopped or given another command: it is over for all of them."""
        left = ", ".join(axis.name for axis in self._axes if axis.motion is not self)
        self._abort(MotionState.CANCELLED, _cancelled(f"axis {left}: {reason}" if left else reason))

    def fail(self, error: CanaxisError) -> None:
        """One of the axes failed: it is over for all of them."""
        self._abort(MotionState.FAILED, error)

    async def close(self) -> None:
        """End it for good, whatever it waits for."""
        if not self._task.done():
            self._abort(MotionState.CANCELLED, _cancelled("The network is being closed."))
            if self._lives:
                self._task.cancel()
            await asyncio.wait({self._task})

    def _abort(self, state: MotionState, error: CanaxisError) -> None:
        """Stop every axis that still takes part, before anything is awaited. The first reason counts."""
        if self._verdict is not None or self.done:
            return
        self._verdict = state, error
        if self._has_sync:
            self._backbone.sync.withdraw()
        for axis in self._axes:
            if axis.motion is self:
                try:
                    axis.begin_stop(f"It moved together with others: {error.message}")
                except Exception as bug:  # one axis's bug must not keep another from its halt
                    self._backbone.report_bug(bug)
        # Behind the halts, also that of the axis whose end this is: nothing may wait for a SYNC any more.
        asyncio.get_running_loop().call_soon(self._prepare_over)
        if self._lives and asyncio.current_task() is not self._task:
            self._task.cancel()

    def _prepare_over(self) -> None:
        self._backbone.sync.make_harmless(self._axes)

    async def _hold(self) -> None:
        """The part of an axis: to be busy with this."""
        await self._over.wait()

    async def _live(self, replaced: Sequence[Axis]) -> None:
        """All of it, to the end."""
        self._lives = True
        try:
            if self._verdict is not None:
                raise asyncio.CancelledError
            result = await self._carry_out(replaced)
            self._over.set()
            # First: whoever waits for the end may command at once.
            while any(axis.motion is self for axis in self._axes):  # noqa: ASYNC110 - their tasks' next turn
                await asyncio.sleep(0)
            if self._verdict is None:
                self._prepare_over()
                self.succeed(result)
                return
        except asyncio.CancelledError:
            if self._verdict is None:
                raise
            if self._task.cancelling():
                self._task.uncancel()
        except CanaxisError as error:
            self._abort(MotionState.FAILED, error)
        except Exception as bug:
            self._abort(MotionState.FAILED, MotionFailed(f"The service failed: {bug!r}."))
            self._backbone.report_bug(bug)
        finally:
            self._release_sync()
        try:
            await self._explain()
            await asyncio.gather(*(axis.stands() for axis in self._axes), return_exceptions=True)
        finally:
            self._prepare_over()
            assert self._verdict is not None, "what does not succeed has a reason"
            self._finish(*self._verdict)

    async def _explain(self) -> None:
        """The emergency often comes just behind the statusword that shows a fault."""
        assert self._verdict is not None
        state, error = self._verdict
        if isinstance(error, AxisFault):
            for axis in self._axes:
                if (axis.node.node_id, axis.number) == (error.node, error.axis):
                    await axis.tools.drive.until(lambda s: bool(s.emergencies), _EMERGENCY_WAIT)
                    if axis.status.emergencies:
                        self._verdict = state, axis.tools.fault(axis.status)

    # --- the move ---

    async def _carry_out(self, replaced: Sequence[Axis]) -> Result:
        for axis in replaced:
            await axis.stands()
        if replaced:
            require_ready(self.members, expected=self)
            for axis in replaced:
                axis.take_part(self, ErrandName.MOVING, self._hold)
        await _all(member.locate() for member in self.members)
        for member in self.members:
            self.evidence.aim(member.axis.id, member.target)
        self.coordination = planned(self.members, self._at_least)
        self.prediction = expected(self.coordination, self.members)
        await _all(member.configure() for member in self.members)
        moving = [member for member in self.members if member.moves]
        self._longest = max(moving, key=lambda member: member.way.distance, default=None)
        if moving:
            await self._watched(lambda: self._travel(moving))
        else:
            self.begin()
        for member in moving:
            member.confirm_end()
        patience = 1.5 * self._backbone.timing.pdo_event_timer
        await _all(member.tools.drive.until(lambda s: s.velocity == 0, patience) for member in moving)
        with contextlib.suppress(
            CanaxisError
        ):  # the next command of the axis brings it back, or says why not
            await _all(member.settle() for member in moving)
        return self._result()

    async def _watched(self, work: Callable[[], Awaitable[None]]) -> None:
        """Do it while every axis is looked at, also those that have arrived or have no way to go."""
        try:
            async with asyncio.TaskGroup() as tasks:
                watchers = [
                    tasks.create_task(member.tools.drive.until(self._looking(member), self._bound))
                    for member in self.members
                ]
                await work()
                for watcher in watchers:
                    watcher.cancel()
        except BaseExceptionGroup as several:
            raise several.exceptions[0] from None

    def _looking(self, member: Member) -> Condition:
        def look(status: AxisStatus) -> bool:
            if member is self._longest:
                self.progress = member.share_done()
            return member.look(status)

        return look

    async def _travel(self, moving: Sequence[Member]) -> None:
        timing = self._backbone.timing
        await self._start(moving)
        late = await self._wait_for(moving, lambda member: member.started, timing.group_start)
        if late:
            raise MotionTimeout(
                f"Axis {late[0].axis.name} did not start with the others; every axis was told to stop.",
                hint="A frame was lost or another master sends SYNCs: see GET /api/v1/bus. Then move again.",
                **late[0].tools.where,
            )
        self._release_sync()
        for member in moving:
            member.lower_set_point()
        late = await self._wait_for(moving, lambda member: member.arrived, self._bound)
        if late:
            raise MotionTimeout(
                f"Axis {late[0].axis.name} did not reach {late[0].target} in the time that it should take.",
                hint="Check load, current and ramps of the axis; every axis was told to stop.",
                **late[0].tools.where,
            )

    async def _start(self, moving: Sequence[Member]) -> None:
        sync = self._backbone.sync
        while sync.user == SYNC_USER:  # noqa: ASYNC110 - another start takes some milliseconds
            await asyncio.sleep(_TURN)
        sync.claim(SYNC_USER)
        self._has_sync = True
        for member in moving:
            member.prepare_target()
        sync.send()
        await _all(member.confirm_target() for member in moving)
        foreign = sync.foreign
        for member in moving:
            member.prepare_start()
        nodes = {member.axis.node.node_id: member for member in moving}
        await _all(member.reached_by_frames() for member in nodes.values())
        if sync.foreign != foreign:
            raise MotionFailed(
                "Another master's SYNC came while the axes were made ready; every axis was told to stop.",
                hint="Let only one master send SYNCs on this bus (080h).",
            )
        for member in self.members:
            member.tools.require_enabled(member.axis.status)
        self._started_at = asyncio.get_running_loop().time()
        sync.send()
        self.begin()

    def _release_sync(self) -> None:
        if self._has_sync:
            self._has_sync = False
            self._backbone.sync.release(SYNC_USER)

    async def _wait_for(
        self, members: Sequence[Member], event: Callable[[Member], asyncio.Event], seconds: float
    ) -> list[Member]:
        """Wait for an event of each; those that it did not come for in time."""
        try:
            async with asyncio.timeout(seconds):
                for member in members:
                    await event(member).wait()
        except TimeoutError:
            pass
        return [member for member in members if not event(member).is_set()]

    @property
    def _bound(self) -> float:
        assert self.coordination is not None
        timing = self._backbone.timing
        return self.coordination.duration_s * timing.motion_factor + timing.motion_margin

    def _result(self) -> Result:
        assert self.coordination is not None
        settled = [m.settled_at - self._started_at for m in self.members if m.settled_at is not None]
        return {
            "predicted_s": round(self.coordination.duration_s, 4),
            "duration_s": round(max(settled, default=0.0), 4),
            "spread_s": round(max(settled, default=0.0) - min(settled, default=0.0), 4),
            "axes": [self._arrival(member) for member in self.members],
        }

    def _arrival(self, member: Member) -> dict[str, int | float | str | None]:
        profile, settled = member.profile, member.settled_at
        return {
            "node": member.axis.node.node_id,
            "axis": member.axis.number,
            "name": member.axis.name,
            "position": member.axis.status.position,
            "target": member.target,
            "velocity": None if profile is None else profile.velocity,
            "acceleration": None if profile is None else profile.acceleration,
            "deceleration": None if profile is None else profile.deceleration,
            "predicted_s": None if profile is None else round(profile.duration_s, 4),
            "arrived_s": None if settled is None else round(settled - self._started_at, 4),
        }

    def _publish(self, _: Operation) -> None:
        axis = self._axes[0]
        alone = len(self._axes) == 1
        axis.backbone.events.publish(
            "motion",
            node=axis.node.node_id,
            axis=axis.number if alone else None,
            data={"motion": self},
        )


async def _all(works: Iterable[Awaitable[object]]) -> None:
    """Wait for all of them, whatever becomes of one; raises what they raised, as one error."""
    found = await asyncio.gather(*works, return_exceptions=True)
    errors = [error for error in found if isinstance(error, BaseException)]
    for error in errors:
        if not isinstance(error, CanaxisError):
            raise error
    if errors:
        raise merged([error for error in errors if isinstance(error, CanaxisError)])


def _cancelled(reason: str) -> MotionCancelled:
    return MotionCancelled(
        f"The motion was cancelled: {reason}", hint="Start it again if it is still wanted."
    )
