"""One axis as its users see it: status, readiness, commands.

It owns what it does; a client only asks for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING

from drivers.bus.frame import Frame
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.devices.emergencies import Severity
from drivers.errors import (
    AxisFault,
    BadValue,
    BusError,
    CanaxisError,
    MotionFailed,
    NodeAway,
    NotReady,
    Obstacle,
)
from drivers.master import positioning, power, referencing, speed, stopping
from drivers.master.axis_setup import AxisSetup
from drivers.master.axis_tools import AxisTools, DriveParameters
from drivers.master.config import AxisConfig
from drivers.master.drive import Drive
from drivers.master.emergencies import EmergencyRecord
from drivers.master.errands import COMING_TO_REST, Errand, ErrandName, Errands
from drivers.master.motion import Motion, MotionKind, Result
from drivers.master.pdo_plan import AxisPdos
from drivers.master.readiness import AxisCommand, obstacles, refusal
from drivers.master.requests import HomeRequest, MoveRequest, Request, VelocityRequest
from drivers.master.status import AxisStatus, NodeState
from drivers.master.watch import Watchdog

if TYPE_CHECKING:
    from drivers.master.node import Node

_FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
_EMERGENCY_WAIT = 0.1
"""How long the emergency that explains a FAULT may come after the statusword."""


class Axis:
    """One motor of a node."""

    def __init__(self, node: Node, number: int, config: AxisConfig, pdos: AxisPdos) -> None:
        self.node = node
        self.number = number
        self.name = config.name
        self.config = config
        self.pdos = pdos
        self.backbone = node.backbone
        timing = self.backbone.timing
        self.adopted = False
        """Whether the axis was found enabled or moving, and nobody has claimed it by `enable` yet."""
        self._motion: Motion | None = None
        self._errands = Errands(f"node {node.node_id} axis {number}", self.backbone.report_bug)
        silence = timing.pdo_event_timer * timing.status_stale
        self._watchdogs = tuple(Watchdog(silence, timing.loop_grace, self._on_silence) for _ in range(2))
        self._drive = Drive(pdos, self.backbone.send, timing, node.counters, self._on_status)
        parameters = DriveParameters(node.objects, number)
        self._tools = AxisTools(node.node_id, number, config, timing, self._drive, node.objects, parameters)
        self.setup = AxisSetup(self._tools)

    # --- what it is and does ---

    @property
    def status(self) -> AxisStatus:
        """The last snapshot. It ages: see `AxisStatus.stale` and `age`."""
        return self._drive.status

    @property
    def motion(self) -> Motion | None:
        """The motion that runs, if one does.

        A turning that has its velocity is no running motion any more.
        """
        return self._motion

    @property
    def errand(self) -> ErrandName | None:
        """What the axis is busy with."""
        return None if self._errands.current is None else self._errands.current.name

    def age(self) -> float | None:
        """Seconds since the older of the two status TPDOs came; None: never."""
        updated = self.status.updated
        return None if math.isinf(updated) else asyncio.get_running_loop().time() - updated

    def readiness(self, command: AxisCommand | str) -> tuple[Obstacle, ...]:
        """Everything that prevents a command now, each with its remedy.

        Raises ValueError for an unknown command.
        """
        return obstacles(self, AxisCommand(command))

    # --- power ---

    async def enable(self) -> None:
        """To OPERATION_ENABLED; nothing moves. Claims an adopted axis. Quiet if it is enabled already.

        Raises `NotReady`, `StopLatched`, `NodeAway`, `TransitionTimeout`, `ConfigurationRefused`.
        """
        self._require(AxisCommand.ENABLE)
        await self._join_or_begin(ErrandName.ENABLING, self._enable)

    async def disable(self) -> None:
        """Ramp down, wait for standstill, then to SWITCH_ON_DISABLED. The motor holds no torque afterwards.

        Always allowed while the node can be reached; ends what runs. Raises `NodeAway`, `TransitionTimeout`.
        """
        self._require(AxisCommand.DISABLE)
        self._begin_disable("The axis was disabled.")
        await self._join()

    async def reset_fault(self) -> None:
        """From FAULT to SWITCH_ON_DISABLED; never enables. Quiet where there is no fault.

        Raises `AxisFault`.
        """
        self._require(AxisCommand.RESET_FAULT)
        if self.errand in COMING_TO_REST:
            with contextlib.suppress(CanaxisError):  # said to whoever asked for it
                await self._join()
            self._require(AxisCommand.RESET_FAULT)
        await self._join_or_begin(ErrandName.RESETTING, lambda: power.reset_fault(self._tools))
        if self.status.state not in _FAULT_STATES:
            self.node.clear_emergencies(self.number)

    # --- coming to rest ---

    async def stop(self, reason: str = "The axis was stopped.") -> None:
        """Ramp down to standstill and stay enabled; returns at standstill. Overtakes and ends everything.

        The halt goes out before the first await. Quiet if the axis stands. Nothing starts again by itself.
        Raises `NodeAway` if the node can't be reached (the halt was sent all the same if the bus could),
        `MotionTimeout`.
        """
        self.begin_stop(reason)
        if self.node.state is NodeState.OPERATIONAL:
            await self._join()
        elif self.node.takes_sdo_commands:
            await stopping.stop_by_sdo(self._tools)
        else:
            raise self._away("It can't be told to stop")

    def begin_stop(self, reason: str) -> None:
        """The part of `stop` that needs no waiting: ends the motion, sends the halt, goes on in a task."""
        self._end_motion(reason)
        if self.errand in COMING_TO_REST:
            return
        self._errands.abandon(self._superseded("a stop"))
        with contextlib.suppress(BusError):  # the task below goes on trying; the bus says what is the matter
            stopping.begin(self._tools)
        if self.node.state is NodeState.OPERATIONAL:
            self._errands.begin(ErrandName.STOPPING, stopping.come_to_rest(self._tools))

    async def quick_stop(self) -> None:
        """Ramp down with 6085h; ends SWITCH_ON_DISABLED (605Ah = 2). Overtakes and ends everything, a stop
        too.

        Raises `NodeAway`, `MotionTimeout`.
        """
        self._end_motion("The axis was quick-stopped.")
        if self.errand is not ErrandName.QUICK_STOPPING:
            self._errands.abandon(self._superseded("a quick stop"))
            stopping.begin_quick_stop(self._tools)
            if self.node.state is not NodeState.OPERATIONAL:
                raise self._away("It can't be told to stop")
            self._errands.begin(ErrandName.QUICK_STOPPING, stopping.finish_quick_stop(self._tools))
        await self._join()

    # --- motions ---

    def move_to(self, request: MoveRequest) -> Motion:
        """Begin a move in profile position mode.

        Raises, before a frame is sent, `BadValue`, `NotReady`, `AxisBusy`, `StopLatched` or `NodeAway`.
        """
        position = self.status.position or 0
        positioning.check_target(
            self._tools, position + request.target if request.relative else request.target
        )
        self._require(AxisCommand.MOVE, absolute=not request.relative)
        return self._start(
            MotionKind.MOVE, request, lambda motion: positioning.move(self._tools, request, motion)
        )

    def run_at(self, request: VelocityRequest) -> Motion:
        """Begin to turn at a velocity; replaces a velocity that is being reached.

        Raises as `move_to` does.
        """
        self._require(AxisCommand.VELOCITY)
        if self.errand is ErrandName.TURNING:
            self._end_motion("Another velocity replaced it.")
            self._errands.abandon(self._superseded("another velocity"))
        return self._start(
            MotionKind.VELOCITY, request, lambda motion: speed.run(self._tools, request, motion)
        )

    def home(self, request: HomeRequest) -> Motion:
        """Begin a homing. Raises as `move_to` does."""
        method = self.config.homing_method if request.method is None else request.method
        known = self.node.profile.homing_methods
        if method not in known or method == 0:
            raise BadValue(
                f"Axis {self.name} has no homing method {method}.",
                hint=f"Choose one of {', '.join(str(m) for m in sorted(known) if m)}.",
                **self._tools.where,
            )
        self._require(AxisCommand.HOME, method=method)
        return self._start(
            MotionKind.HOME, request, lambda motion: referencing.home(self._tools, request, motion)
        )

    # --- for the node ---

    def route(self, add: Callable[[int, Callable[[Frame], None]], None]) -> None:
        """Have the status TPDOs brought here."""
        add(self.pdos.status.cob_id, self._drive.on_status_pdo)
        add(self.pdos.motion.cob_id, self._drive.on_motion_pdo)

    def seed(self, statusword: int, mode: int, position: int) -> None:
        """What was read by SDO before PDOs flow."""
        self._drive.seed(statusword, mode, position)

    async def has_status(self, seconds: float) -> bool:
        """Wait until both status TPDOs have come."""
        return await self._drive.until(lambda status: not status.stale, seconds)

    def interrupt(self, error: CanaxisError, *, stop: bool) -> None:
        """Something outside ended what the axis did; with `stop` the halt is tried too."""
        if self._motion is not None:
            self._motion.fail(error)
            self._motion = None
        if stop and (self.errand in COMING_TO_REST):
            return
        self._errands.abandon(error)
        if stop:
            self.begin_stop(error.message)

    def forget(self) -> None:
        """The module started anew: no reference, no parameters, nothing commanded."""
        for watchdog in self._watchdogs:
            watchdog.stop()
        self.adopted = False
        self._tools.parameters.forget()
        self._drive.note(referenced=False)
        self._drive.forget()

    def lose(self) -> None:
        """The node is away: the status is old, and whether the reference holds is unknown."""
        for watchdog in self._watchdogs:
            watchdog.stop()
        self._tools.parameters.forget()
        self._drive.note(referenced=False)
        self._drive.note_stale()

    def on_emergencies(self, active: tuple[EmergencyRecord, ...], newest: EmergencyRecord | None) -> None:
        """The node's emergencies changed; a new one that is a fault ends the motion."""
        self._drive.note_emergencies(active)
        if self._motion is None or newest is None or newest.axis != self.number:
            return
        if newest.active and newest.severity is Severity.FAULT:
            self.interrupt(self._tools.fault(self.status), stop=self.status.state not in _FAULT_STATES)

    def parameter_written(self, index: int, sub: int) -> None:
        """Somebody wrote an object past the commands."""
        self._tools.parameters.forget(Address(index, sub))

    async def shut_down(self) -> None:
        """Ramp down and disable, whatever runs; as `disable`, but while the network refuses new work.

        An axis whose node is away can't be told; its module stops it when our heartbeat ends.
        """
        if self.node.state is NodeState.OPERATIONAL:
            self._begin_disable("The service is shutting down.")
            await self._join()
        elif self.node.takes_sdo_commands:
            await stopping.stop_by_sdo(self._tools)

    async def close(self) -> None:
        """End every task."""
        for watchdog in self._watchdogs:
            watchdog.stop()
        self._end_motion("The network is being closed.")
        await self._errands.close(self._away("The network is being closed"))

    # --- inside ---

    def _require(self, command: AxisCommand, *, absolute: bool = True, method: int | None = None) -> None:
        found = obstacles(self, command, absolute=absolute, method=method)
        if found:
            raise refusal(self, command, found)

    async def _join_or_begin(
        self, name: ErrandName, work: Callable[[], Coroutine[object, object, None]]
    ) -> None:
        if self.errand is not name:
            self._errands.begin(name, work())
        await self._join()

    async def _join(self) -> None:
        if self._errands.current is not None:
            await self._errands.current.join()

    async def _enable(self) -> None:
        if self.adopted:
            await self.setup.claim()
            self.adopted = False
        await power.enable(self._tools)

    def _begin_disable(self, reason: str) -> None:
        self._end_motion(reason)
        if self.errand is not ErrandName.DISABLING:
            self._errands.abandon(self._superseded("a disable"))
            stopping.begin(self._tools)
            self._errands.begin(ErrandName.DISABLING, self._disable())

    async def _disable(self) -> None:
        if self._drive.energised:
            await stopping.come_to_rest(self._tools)
        await power.disable(self._tools)

    def _start(
        self, kind: MotionKind, request: Request, work: Callable[[Motion], Coroutine[object, object, Result]]
    ) -> Motion:
        motion = Motion(kind, self, request, self._on_motion)
        self._motion = motion
        name = {
            MotionKind.MOVE: ErrandName.MOVING,
            MotionKind.VELOCITY: ErrandName.TURNING,
            MotionKind.HOME: ErrandName.HOMING,
        }[kind]
        self._on_motion(motion)
        self._errands.begin(name, self._carry_out(motion, work))
        return motion

    async def _carry_out(
        self, motion: Motion, work: Callable[[Motion], Coroutine[object, object, Result]]
    ) -> None:
        """Drive a motion to its end; what fails is brought to rest before the axis is free again."""
        errand = self._errands.current
        try:
            result = await work(motion)
        except AxisFault as fault:
            motion.fail(await self._explained(fault))
        except CanaxisError as error:
            motion.fail(error)
            await self._rest_after_failure(errand)
        except Exception as bug:
            motion.fail(MotionFailed(f"Axis {self.name}: the service failed: {bug!r}.", **self._tools.where))
            raise
        else:
            self._errands.release(errand)  # first: whoever waits for the end may command at once
            self._forget_motion(motion)
            motion.succeed(result)
        finally:
            self._forget_motion(motion)

    def _forget_motion(self, motion: Motion) -> None:
        if self._motion is motion:
            self._motion = None

    async def _explained(self, fault: AxisFault) -> AxisFault:
        """The emergency often comes just behind the statusword."""
        if self.status.emergencies:
            return fault
        await self._drive.until(lambda s: bool(s.emergencies), _EMERGENCY_WAIT)
        return self._tools.fault(self.status)

    async def _rest_after_failure(self, errand: Errand | None) -> None:
        if errand is not None:
            errand.name = ErrandName.STOPPING
        if self._drive.energised:
            try:
                stopping.begin(self._tools)
            except BusError:
                return  # the motion's error says already that it failed; the bus says why
            await stopping.come_to_rest(self._tools)

    def _end_motion(self, reason: str) -> None:
        if self._motion is not None:
            self._motion.give_up(reason)
            self._motion = None

    def _superseded(self, what: str) -> NotReady:
        obstacle = Obstacle(
            "superseded", f"It was ended by {what}.", "Give the command again if it is still wanted."
        )
        return NotReady(
            f"Axis {self.name}: {obstacle.message}",
            obstacles=(obstacle,),
            node=self.node.node_id,
            axis=self.number,
        )

    def _away(self, what: str) -> NodeAway:
        return NodeAway(
            f"{what}: node {self.node.name} is {self.node.state}. Whether axis {self.name} moves is unknown.",
            hint="Use the module's enable input or cut the motor supply if it must stand; check the cable.",
            **self._tools.where,
        )

    def _on_motion(self, motion: Motion) -> None:
        self.backbone.events.publish(
            "motion", node=self.node.node_id, axis=self.number, data={"motion": motion}
        )

    def _on_status(self, status: AxisStatus) -> None:
        for watchdog, heard in zip(
            self._watchdogs, (self._drive.status_at, self._drive.motion_at), strict=True
        ):
            if heard is not None:
                watchdog.feed(heard)
        self.backbone.events.publish(
            "axis", node=self.node.node_id, axis=self.number, data={"status": status}
        )

    def _on_silence(self) -> None:
        self._drive.note_stale()
        if self._motion is not None:
            self.interrupt(
                NodeAway(
                    f"The status of axis {self.name} stopped coming during the motion; a stop was sent.",
                    hint="Whether the axis stands is unknown until its status is back.",
                    **self._tools.where,
                ),
                stop=True,
            )
