"""One axis as its users see it: status, readiness, commands.

It owns what it does; a client only asks for it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Coroutine

from drivers.errors import BadValue, CanaxisError, Obstacle
from drivers.master.axis.admission import Admission, admit
from drivers.master.axis.body import FAULT_STATES, AxisBody
from drivers.master.axis.commands import AxisCommand
from drivers.master.axis.errands import ErrandName
from drivers.master.axis.outlook import Preview, expected, look_ahead, starting_point
from drivers.master.axis.readiness import obstacles, refusal
from drivers.master.axis.waiting_line import Waiting
from drivers.master.drive import power, stopping
from drivers.master.motions import homing, jogging, position_setting, profile_position, profile_velocity
from drivers.master.motions.jogging import Jog
from drivers.master.motions.motion import Motion, MotionKind, Result
from drivers.master.plan.requests import (
    HomeRequest,
    JogRequest,
    MoveRequest,
    OnBusy,
    Request,
    SetPositionRequest,
    VelocityRequest,
)


class Axis(AxisBody):
    """One motor of a node."""

    def readiness(self, command: AxisCommand | str) -> tuple[Obstacle, ...]:
        """Everything that prevents a command now, each with its remedy.

        Raises ValueError for an unknown command.
        """
        return obstacles(self, AxisCommand(command))

    def check_position(self, position: int) -> None:
        """Raise `BadValue` for a position (steps) outside of the travel limits."""
        profile_position.check_target(self._tools, position, "position")

    # --- power ---

    async def enable(self) -> None:
        """To OPERATION_ENABLED; nothing moves. Claims an adopted axis. Quiet if it is enabled already.

        Raises `NotReady`, `StopLatched`, `NodeAway`, `TransitionTimeout`, `ConfigurationRefused`.
        """
        self._require(AxisCommand.ENABLE)
        await self._join_or_begin(ErrandName.ENABLING, self._enable)

    async def disable(self) -> None:
        """Ramp down, wait for standstill, then to SWITCH_ON_DISABLED. The motor holds no torque afterwards.

        Always allowed while the node can be reached; ends what runs. An axis that can't be seen to stand is
        not switched off: it is told to stop, as far as the bus takes that, and the refusal is raised. Raises
        `NodeAway`, `TransitionTimeout`.
        """
        if found := obstacles(self, AxisCommand.DISABLE):
            self.begin_stop("The axis was to be disabled.")
            raise refusal(self, AxisCommand.DISABLE, found)
        self._begin_disable("The axis was disabled.")
        await self._activity.join()

    async def reset_fault(self) -> None:
        """From FAULT to SWITCH_ON_DISABLED; never enables. Quiet where there is no fault.

        Raises `AxisFault`.
        """
        self._require(AxisCommand.RESET_FAULT)
        while self._activity.coming_to_rest:  # another one may follow the first
            with contextlib.suppress(CanaxisError):  # said to whoever asked for it
                await self._activity.join()
            self._require(AxisCommand.RESET_FAULT)
        await self._join_or_begin(ErrandName.RESETTING, lambda: power.reset_fault(self._tools))
        if self.status.state not in FAULT_STATES:
            self._clear_emergencies(self.number)

    # --- coming to rest ---

    async def stop(self, reason: str = "The axis was stopped.") -> None:
        """Ramp down to standstill and stay enabled; returns at standstill. Overtakes and ends everything.

        The halt goes out before the first await. Quiet if the axis stands. Nothing starts again by itself.
        An enabling that is under way is taken back. Raises `NodeAway` if the node can't be reached (the halt
        was sent all the same if the bus could), `MotionTimeout`, `TransitionTimeout`.
        """
        self.begin_stop(reason)
        if self.in_reach:
            await self._activity.join_rest()
        elif self.node.takes_sdo_commands:
            await stopping.stop_by_sdo(self._tools)
        else:
            raise self._away("It can't be told to stop")

    async def quick_stop(self) -> None:
        """Ramp down with 6085h; ends SWITCH_ON_DISABLED (605Ah = 2). Overtakes and ends everything, a stop
        too.

        Raises `NodeAway`, `MotionTimeout`.
        """
        self._activity.cancel_motion("The axis was quick-stopped.")
        if self.errand is not ErrandName.QUICK_STOPPING:
            self._activity.let_go()
            self._activity.give_way("a quick stop")
            stopping.begin_quick_stop(self._tools)
            if not self.in_reach:
                if not self.node.takes_sdo_commands:
                    raise self._away("It can't be told to stop")
                await stopping.quick_stop_by_sdo(self._tools)
                return
            self._activity.begin(ErrandName.QUICK_STOPPING, stopping.finish_quick_stop(self._tools))
        await self._activity.join()

    # --- motions ---

    def move_to(
        self,
        request: MoveRequest,
        *,
        on_busy: OnBusy = OnBusy.REJECT,
        operation_id: str | None = None,
    ) -> Motion:
        """Begin a move in profile position mode, or have it wait or replace what runs, as `on_busy` says.

        Raises, before a frame is sent, `BadValue`, `NotReady`, `AxisBusy`, `LineFull`, `StopLatched` or
        `NodeAway`.
        """
        self._check(request)
        self._check_way(request, on_busy)
        return self._undertake(MotionKind.MOVE, request, on_busy, operation_id)

    def run_at(
        self,
        request: VelocityRequest,
        *,
        on_busy: OnBusy = OnBusy.REJECT,
        operation_id: str | None = None,
    ) -> Motion:
        """Begin to turn at a velocity. One velocity without an end replaces another, whatever `on_busy` says.

        Raises as `move_to` does.
        """
        self._check(request)
        if (move := request.as_move) is not None:
            self._check_way(move, on_busy)
        return self._undertake(MotionKind.VELOCITY, request, on_busy, operation_id)

    def home(
        self,
        request: HomeRequest,
        *,
        on_busy: OnBusy = OnBusy.REJECT,
        operation_id: str | None = None,
    ) -> Motion:
        """Begin a homing. Raises as `move_to` does."""
        self._check(request)
        return self._undertake(MotionKind.HOME, request, on_busy, operation_id)

    def jog(self, request: JogRequest, *, held_at: float, operation_id: str | None = None) -> Jog:
        """Begin to turn for as long as `Jog.hold` is called; `held_at`: loop time of the first hold.

        Raises as `move_to` does; `BadValue` too at a software limit.
        """
        self.config.check_rates(velocity=abs(request.velocity), acceleration=request.acceleration)
        self._require(AxisCommand.JOG)
        jogging.check_room(self._tools, request.velocity)
        jog = Jog(self._tools, request, held_at, self._on_motion, self._end, operation_id)
        self._on_motion(jog)
        self._activity.carry_out(jog, lambda _: jogging.run(self._tools, jog))
        return jog

    def set_position(self, request: SetPositionRequest, *, operation_id: str | None = None) -> Motion:
        """Begin to say where the standing axis is; nothing moves. It needs no power.

        Raises as `move_to` does; `NotReady` too where that would move the travel limits of a homed axis.
        """
        self._require(AxisCommand.SET_POSITION)
        position_setting.check(self._tools, request)
        return self._undertake(MotionKind.SET_POSITION, request, OnBusy.REJECT, operation_id)

    def preview(self, request: Request, on_busy: OnBusy = OnBusy.REJECT) -> Preview:
        """What a command would come to, and what prevents it now, also of a disabled axis. Nothing is sent.

        Raises `BadValue` for a rate or a homing method that no state of the axis makes right.
        """
        self._check(request)
        return look_ahead(self, self._tools, request, on_busy)

    def withdraw(self, motion: Motion, reason: str) -> bool:
        """Cancel a motion that waits, with what waits behind it; False if the axis must stop for that."""
        return self._activity.withdraw(motion, reason)

    # --- inside ---

    async def _end(self, motion: Motion, reason: str) -> None:
        """See `Motion.cancel`: a motion that waits is withdrawn; else the axis stops."""
        if not self.withdraw(motion, reason):
            await self.stop(reason)

    def _require(self, command: AxisCommand, *, absolute: bool = True, method: int | None = None) -> None:
        found = obstacles(self, command, absolute=absolute, method=method)
        if found:
            raise refusal(self, command, found)

    async def _join_or_begin(
        self, name: ErrandName, work: Callable[[], Coroutine[object, object, None]]
    ) -> None:
        if self.errand is not name:
            self._activity.begin(name, work())
        await self._activity.join()

    async def _enable(self) -> None:
        if self.adopted:
            if self._drive.energised:  # a set point that was halted half-way would go on with the next move
                stopping.begin(self._tools)
                await stopping.come_to_rest(self._tools)
            await self.setup.claim()
            self._drive.note_adoption(None)
        await power.enable(self._tools)

    def _check_way(self, request: MoveRequest, on_busy: OnBusy) -> None:
        """Raise `BadValue` for a target out of reach. Where a relative one begins may not be known before it
        does: then it is checked there.
        """
        if not request.relative:
            profile_position.check_target(self._tools, request.target)
        elif (start := starting_point(self, on_busy)) is not None:
            profile_position.check_target(self._tools, start + request.target)

    def _check(self, request: Request) -> None:
        """Raise `BadValue` for rates that the axis may not have, and a method that the module doesn't."""
        match request:
            case MoveRequest():
                self.config.check_rates(
                    velocity=request.velocity,
                    acceleration=request.acceleration,
                    deceleration=request.deceleration,
                )
            case VelocityRequest():
                self.config.check_rates(velocity=abs(request.velocity), acceleration=request.acceleration)
            case HomeRequest():
                for velocity in (request.fast, request.slow):
                    self.config.check_rates(velocity=velocity, acceleration=request.acceleration)
                self._check_method(request)
            case _:
                pass

    def _check_method(self, request: HomeRequest) -> None:
        method = self.config.homing_method if request.method is None else request.method
        known = self.node.profile.homing_methods
        if method not in known or method == 0:
            raise BadValue(
                f"Axis {self.name} has no homing method {method}.",
                hint=f"Choose one of {', '.join(str(m) for m in sorted(known) if m)}.",
                **self._tools.where,
            )

    def _undertake(
        self, kind: MotionKind, request: Request, on_busy: OnBusy, operation_id: str | None
    ) -> Motion:
        admission = admit(self, request, on_busy)
        motion = Motion(kind, self._tools, request, self._on_motion, self._end, operation_id)
        motion.prediction = expected(self, self._tools, request, admission)
        self._on_motion(motion)
        match admission:
            case Admission.QUEUE:
                self._activity.line.join(Waiting(motion, lambda: self._begin(motion)))
            case Admission.REPLACE:
                self._activity.make_way(Waiting(motion, lambda: self._begin(motion)))
            case Admission.TAKE_OVER:
                self._activity.cancel_motion("Another velocity replaced it.")
                self._activity.give_way("another velocity")
                self._activity.carry_out(motion, self._work)
            case Admission.AT_ONCE:
                self._activity.carry_out(motion, self._work)
        return motion

    def _begin(self, motion: Motion) -> None:
        """The turn of a motion that waited has come: whether it may be given is asked anew."""
        admit(self, motion.request, OnBusy.REJECT)
        self._activity.carry_out(motion, self._work)

    async def _work(self, motion: Motion) -> Result:
        tools = self._tools
        match motion.request:
            case MoveRequest() as move:
                return await profile_position.move(tools, move, motion)
            case VelocityRequest() as velocity:
                return await profile_velocity.run(tools, velocity, motion)
            case HomeRequest() as home:
                return await homing.home(tools, home, motion)
            case SetPositionRequest() as position:
                return await position_setting.set_position(tools, position, motion)
            case JogRequest():
                raise AssertionError("a jog is carried out by those who hold it")
