"""What an axis is busy with: at most one errand, the motion that it may be for, and how both end."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Protocol

from drivers.errors import AxisFault, CanaxisError, MotionFailed, NotReady
from drivers.master.axis.errands import COMING_TO_REST, Errand, ErrandName, Errands
from drivers.master.axis.waiting_line import Waiting, WaitingLine
from drivers.master.drive import stopping
from drivers.master.drive.tools import AxisTools
from drivers.master.motions.motion import Motion, MotionKind, Operation, Result
from drivers.master.plan.requests import VelocityRequest
from drivers.obstacles import SUPERSEDED

Work = Coroutine[object, object, None]
MotionWork = Callable[[Motion], Coroutine[object, object, Result]]

_EMERGENCY_WAIT = 0.1
"""How long the emergency that explains a FAULT may come after the statusword."""
_ERRANDS = {
    MotionKind.MOVE: ErrandName.MOVING,
    MotionKind.VELOCITY: ErrandName.TURNING,
    MotionKind.HOME: ErrandName.HOMING,
    MotionKind.SET_POSITION: ErrandName.SETTING_POSITION,
    MotionKind.JOG: ErrandName.JOGGING,
}


class Guide(Protocol):
    """Who leads an axis along a path that only it knows, and can bring it to rest on that path."""

    def brake(self) -> None:
        """Begin to come to rest, now."""
        ...

    async def at_rest(self) -> bool:
        """Wait until nothing more comes; False if it did not come to rest, so that the drive must be halted.
        Bounded.
        """
        ...

    def cut(self) -> None:
        """Let go of every axis, now: nothing more may be sent to them."""
        ...


class Activity:
    """Begins, joins, replaces and ends what one axis does. Nothing that it ends starts again."""

    def __init__(self, tools: AxisTools, on_bug: Callable[[BaseException], None]) -> None:
        self._tools = tools
        self._errands = Errands(f"node {tools.node_id} axis {tools.number}", on_bug)
        self.motion: Operation | None = None
        """The motion that runs, if one does: the axis's own, or one in which it takes part."""
        self._guide: Guide | None = None
        self.line = WaitingLine()
        """What is begun when that has succeeded."""

    @property
    def errand(self) -> ErrandName | None:
        """What the axis is busy with."""
        return None if self._errands.current is None else self._errands.current.name

    @property
    def coming_to_rest(self) -> bool:
        """Whether what runs ends at standstill."""
        return self.errand in COMING_TO_REST

    @property
    def making_way(self) -> bool:
        """Whether what runs ends at standstill so that the first in line can begin."""
        return bool(self.line) and (self.motion is None or self.motion.done)

    @property
    def last(self) -> Motion | None:
        """The motion of this axis alone that is begun last of all that was accepted; None: there is none."""
        if self.line:
            return self.line.motions[-1]
        return self.motion if isinstance(self.motion, Motion) and not self.motion.done else None

    # --- beginning ---

    def begin(self, name: ErrandName, work: Work) -> None:
        """Start an errand; none may be running."""
        self._errands.begin(name, work)

    def carry_out(self, motion: Motion, work: MotionWork) -> None:
        """Start the errand that a motion is; no errand may be running."""
        self.motion = motion
        self._errands.begin(_errand(motion), self._carry_out(motion, work))

    def make_way(self, waiting: Waiting) -> None:
        """Cancel what runs and what waits, send the halt, and begin the new one once the axis stands."""
        coming_to_rest = self.making_way
        self.cancel_motion("Another command replaced it.")
        self.line.join(waiting)
        if not coming_to_rest:
            self.give_way("another command")
            stopping.begin(self._tools)
            self._errands.begin(ErrandName.STOPPING, self._make_way())

    def expect(self, operation: Operation) -> None:
        """What the axis does ends, and it takes part in this then: whatever ends it until then ends this."""
        self.motion = operation

    def take_part(
        self,
        operation: Operation,
        name: ErrandName,
        work: Callable[[], Work],
        guide: Guide | None = None,
    ) -> None:
        """Start this axis's part of what several do; no errand may be running.

        What fails here fails the whole, which has every axis stop. The whole succeeds by whoever leads it.
        With a `guide`, that brings the axis to rest as long as it leads it.
        """
        self.motion, self._guide = operation, guide
        self._errands.begin(name, self._take_part(operation, work))

    # --- waiting ---

    async def join(self) -> None:
        """Wait for the end of what runs, if anything; raises what it raised, or why it was ended."""
        if self._errands.current is not None:
            await self._errands.current.join()

    async def join_rest(self) -> None:
        """Wait for standstill, also where another coming to rest takes over from the one that was begun."""
        while (errand := self._errands.current) is not None:
            try:
                await errand.join()
            except NotReady:
                if errand.ended_by is None or not self.coming_to_rest:
                    raise
            else:
                return

    # --- ending ---

    def cancel_motion(self, reason: str) -> None:
        """End the motion on purpose, if one runs, and all that waits; the errand that carries it out is not
        touched.
        """
        motion, self.motion = self.motion, None  # first: the end of what several do has the others stopped
        if motion is not None:
            motion.give_up(reason)
        self.line.clear(reason)

    def fail_motion(self, error: CanaxisError) -> None:
        """End the motion as failed, if one runs, and cancel all that waits; the errand that carries it out is
        not touched.
        """
        motion, self.motion = self.motion, None
        if motion is not None:
            motion.fail(error)
        self.line.clear(error.message)

    def withdraw(self, motion: Motion, reason: str) -> bool:
        """Cancel a motion that waits, and leave what runs alone. False if the axis must stop for that."""
        if self.making_way and self.line.motions[0] is motion:
            return False
        return self.line.leave(motion, reason)

    def abandon(self, error: CanaxisError) -> None:
        """End the errand, if one runs; whoever waits for it gets `error`."""
        self._errands.abandon(error)

    def give_way(self, what: str) -> None:
        """`abandon` for another command of somebody's."""
        obstacle = SUPERSEDED.found(f"It was ended by {what}.")
        message = f"Axis {self._tools.config.name}: {obstacle.message}"
        self._errands.abandon(
            NotReady(message, obstacles=(obstacle,), node=self._tools.node_id, axis=self._tools.number)
        )

    def begin_rest(self) -> Callable[[], Work]:
        """Begin to come to rest, now, and what makes the work that is left of that: along the path if
        somebody leads the axis, else by the drive's own halt.
        """
        guide = self._guide
        if guide is None:
            stopping.begin(self._tools)
            return lambda: stopping.come_to_rest(self._tools)
        guide.brake()
        return lambda: self._rest_along(guide)

    def let_go(self) -> None:
        """Whoever leads the axis sends nothing more, to it and to the others that it leads."""
        guide, self._guide = self._guide, None
        if guide is not None:
            guide.cut()

    async def close(self, error: CanaxisError) -> None:
        """Abandon what runs and wait until every task is gone."""
        self.let_go()
        await self._errands.close(error)

    # --- a motion ---

    async def _carry_out(self, motion: Motion, work: MotionWork) -> None:
        """Drive a motion to its end; what fails is brought to rest before the axis is free again."""
        errand = self._errands.current
        assert errand is not None, "the errand begins before its task runs"
        try:
            result = await work(motion)
        except AxisFault as fault:
            self._fail(motion, await self._explained(fault))
        except CanaxisError as error:
            self._fail(motion, error)
            await self._rest_after_failure(errand)
        except Exception as bug:
            name, where = self._tools.config.name, self._tools.where
            self._fail(motion, MotionFailed(f"Axis {name}: the service failed: {bug!r}.", **where))
            raise
        else:
            self._errands.release(errand)  # first: whoever waits for the end may command at once
            self._forget(motion)
            motion.succeed(result)
            self._begin_next()
        finally:
            self._forget(motion)

    async def _take_part(self, operation: Operation, work: Callable[[], Work]) -> None:
        """The end of the whole has every axis stopped, this one too."""
        try:
            await work()
        except AxisFault as fault:
            operation.fail(await self._explained(fault))
        except CanaxisError as error:
            operation.fail(error)
        except Exception as bug:
            name, where = self._tools.config.name, self._tools.where
            operation.fail(MotionFailed(f"Axis {name}: the service failed: {bug!r}.", **where))
            raise
        else:
            self._guide = None
        finally:
            self._forget(operation)

    async def _rest_along(self, guide: Guide) -> None:
        if not await guide.at_rest():
            guide.cut()
        if self._guide is guide:
            self._guide = None
        stopping.begin(self._tools)
        await stopping.come_to_rest(self._tools)

    async def _make_way(self) -> None:
        try:
            await stopping.come_to_rest(self._tools)
        except CanaxisError as error:
            self.line.clear(error.message)
            raise
        self._errands.release(self._errands.current)
        self._begin_next()

    def _begin_next(self) -> None:
        """Begin what is first in line, if the axis is free; what may not begin takes the others along."""
        if self._errands.current is not None or (waiting := self.line.next()) is None:
            return
        motion = waiting.motion
        motion.has_its_turn()
        try:
            waiting.begin()
        except CanaxisError as error:
            self._fail(motion, error)

    def _fail(self, motion: Motion, error: CanaxisError) -> None:
        motion.fail(error)
        self.line.clear(f"The operation before it failed: {error.message}")

    def _forget(self, motion: Operation) -> None:
        if self.motion is motion:
            self.motion = None

    async def _explained(self, fault: AxisFault) -> AxisFault:
        """The emergency often comes just behind the statusword."""
        drive = self._tools.drive
        if drive.status.emergencies:
            return fault
        await drive.until(lambda s: bool(s.emergencies), _EMERGENCY_WAIT)
        return self._tools.fault(drive.status)

    async def _rest_after_failure(self, errand: Errand) -> None:
        errand.name = ErrandName.STOPPING
        if self._tools.drive.energised:
            stopping.begin(self._tools)
            await stopping.come_to_rest(self._tools)


def _errand(motion: Motion) -> ErrandName:
    request = motion.request
    if isinstance(request, VelocityRequest) and request.travel is not None:
        return ErrandName.MOVING  # in profile position mode: no other velocity can take over from it
    return _ERRANDS[motion.kind]
