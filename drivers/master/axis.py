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
    BadValue,
    CanaxisError,
    NodeAway,
    Obstacle,
)
from drivers.master import positioning, power, referencing, speed, stopping
from drivers.master.activity import Activity
from drivers.master.axis_setup import AxisSetup
from drivers.master.axis_tools import AxisTools, DriveParameters
from drivers.master.config import AxisConfig
from drivers.master.drive import Drive
from drivers.master.emergencies import EmergencyRecord
from drivers.master.errands import ErrandName
from drivers.master.motion import Motion, MotionKind, Result
from drivers.master.pdo_plan import AxisPdos
from drivers.master.readiness import AxisCommand, obstacles, refusal
from drivers.master.requests import HomeRequest, MoveRequest, Request, VelocityRequest
from drivers.master.status import AxisStatus, NodeState

if TYPE_CHECKING:
    from drivers.master.node import Node

_FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)


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
        self._owes_stop = False
        """Whether it was out of reach since it was commanded, so that it must stand before anything else."""
        self._drive = Drive(
            pdos, self.backbone.send, timing, node.counters, self._on_status, self._on_silence
        )
        parameters = DriveParameters(node.objects, number)
        self._tools = AxisTools(node.node_id, number, config, timing, self._drive, node.objects, parameters)
        self._activity = Activity(self._tools, self.backbone.report_bug)
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
        return self._activity.motion

    @property
    def errand(self) -> ErrandName | None:
        """What the axis is busy with."""
        return self._activity.errand

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
        await self._activity.join()

    async def reset_fault(self) -> None:
        """From FAULT to SWITCH_ON_DISABLED; never enables. Quiet where there is no fault.

        Raises `AxisFault`.
        """
        self._require(AxisCommand.RESET_FAULT)
        if self._activity.coming_to_rest:
            with contextlib.suppress(CanaxisError):  # said to whoever asked for it
                await self._activity.join()
            self._require(AxisCommand.RESET_FAULT)
        await self._join_or_begin(ErrandName.RESETTING, lambda: power.reset_fault(self._tools))
        if self.status.state not in _FAULT_STATES:
            self.node.clear_emergencies(self.number)

    # --- coming to rest ---

    async def stop(self, reason: str = "The axis was stopped.") -> None:
        """Ramp down to standstill and stay enabled; returns at standstill. Overtakes and ends everything.

        The halt goes out before the first await. Quiet if the axis stands. Nothing starts again by itself.
        An enabling that is under way is taken back. Raises `NodeAway` if the node can't be reached (the halt
        was sent all the same if the bus could), `MotionTimeout`, `TransitionTimeout`.
        """
        self.begin_stop(reason)
        if self.node.state is NodeState.OPERATIONAL:
            await self._activity.join_rest()
        elif self.node.takes_sdo_commands:
            await stopping.stop_by_sdo(self._tools)
        else:
            raise self._away("It can't be told to stop")

    def begin_stop(self, reason: str) -> None:
        """The part of `stop` that needs no waiting: ends the motion, sends the halt, goes on in a task."""
        self._activity.cancel_motion(reason)
        if self._activity.coming_to_rest:
            return
        self._activity.give_way("a stop")
        stopping.begin(self._tools)
        if self.node.state is NodeState.OPERATIONAL:
            self._activity.begin(ErrandName.STOPPING, stopping.come_to_rest(self._tools))

    async def quick_stop(self) -> None:
        """Ramp down with 6085h; ends SWITCH_ON_DISABLED (605Ah = 2). Overtakes and ends everything, a stop
        too.

        Raises `NodeAway`, `MotionTimeout`.
        """
        self._activity.cancel_motion("The axis was quick-stopped.")
        if self.errand is not ErrandName.QUICK_STOPPING:
            self._activity.give_way("a quick stop")
            stopping.begin_quick_stop(self._tools)
            if self.node.state is not NodeState.OPERATIONAL:
                raise self._away("It can't be told to stop")
            self._activity.begin(ErrandName.QUICK_STOPPING, stopping.finish_quick_stop(self._tools))
        await self._activity.join()

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
            self._activity.cancel_motion("Another velocity replaced it.")
            self._activity.give_way("another velocity")
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
        self._activity.fail_motion(error)
        if stop and self._activity.coming_to_rest:
            return
        self._activity.abandon(error)
        if stop:
            self.begin_stop(error.message)

    def back_in_reach(self) -> None:
        """The node is operational: an axis that turns, though it was to stop meanwhile, is stopped now."""
        latch = self.backbone.stop_latched
        if self.status.moving and latch is not None:
            self.begin_stop(f"A stop for everything is latched: {latch.reason}")
        elif self.status.moving and self._owes_stop:
            self.begin_stop("The axis was out of reach after it had been commanded.")
        self._owes_stop = False

    def forget(self) -> None:
        """The module started anew: no reference, no parameters, nothing commanded."""
        self.adopted = False
        self._owes_stop = False
        self._tools.parameters.forget()
        self._drive.note(referenced=False)
        self._drive.forget()

    def lose(self) -> None:
        """The node is away: the status is old, and whether the reference holds is unknown."""
        self._owes_stop = self._owes_stop or self._drive.controlword is not None
        self._drive.unwatch()
        self._tools.parameters.forget()
        self._drive.note(referenced=False)
        self._drive.note_stale()

    def on_emergencies(self, active: tuple[EmergencyRecord, ...], newest: EmergencyRecord | None) -> None:
        """The node's emergencies changed; a new one that is a fault ends the motion."""
        self._drive.note_emergencies(active)
        if self.motion is None or newest is None or newest.axis != self.number:
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
            await self._activity.join()
        elif self.node.takes_sdo_commands:
            await stopping.stop_by_sdo(self._tools)

    async def close(self) -> None:
        """End every task."""
        self._drive.unwatch()
        self._activity.cancel_motion("The network is being closed.")
        await self._activity.close(self._away("The network is being closed"))

    # --- inside ---

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
            self.adopted = False
        await power.enable(self._tools)

    def _begin_disable(self, reason: str) -> None:
        self._activity.cancel_motion(reason)
        if self.errand is not ErrandName.DISABLING:
            self._activity.give_way("a disable")
            stopping.begin(self._tools)
            self._activity.begin(ErrandName.DISABLING, self._disable())

    async def _disable(self) -> None:
        if self._drive.energised:
            await stopping.come_to_rest(self._tools)
        await power.disable(self._tools)

    def _start(
        self, kind: MotionKind, request: Request, work: Callable[[Motion], Coroutine[object, object, Result]]
    ) -> Motion:
        motion = Motion(kind, self, request, self._on_motion)
        self._on_motion(motion)
        self._activity.carry_out(motion, work)
        return motion

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
        self.backbone.events.publish(
            "axis", node=self.node.node_id, axis=self.number, data={"status": status}
        )

    def _on_silence(self) -> None:
        """A status TPDO is overdue. `interrupt` lets a coming to rest go on."""
        if self.motion is not None or self.status.moving:
            self.interrupt(
                NodeAway(
                    f"The status of axis {self.name} stopped coming while it moved; a stop was sent.",
                    hint="Whether the axis stands is unknown until its status is back.",
                    **self._tools.where,
                ),
                stop=True,
            )
