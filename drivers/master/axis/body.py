"""One axis as its node has it: its status, its losses, what ends its motions from outside."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

from drivers.bus.frame import Frame
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.devices.emergencies import Severity
from drivers.errors import CanaxisError, NodeAway
from drivers.master.axis.activity import Activity, Guide, Work
from drivers.master.axis.errands import ErrandName
from drivers.master.axis.loss_check import LossCheck
from drivers.master.drive import power, stopping
from drivers.master.drive.drive import Condition, Drive
from drivers.master.drive.setup import AxisSetup, Found
from drivers.master.drive.tools import AxisTools, CurrentConfig, DriveParameters
from drivers.master.link.node_link import NodeLink
from drivers.master.motions.motion import Motion, Operation
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.pdo_plan import AxisPdos
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.status import Adoption, AxisStatus, NodeState, Reference

FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)


class AxisBody:
    """What an axis is and does without being commanded; `Axis` adds the commands."""

    def __init__(
        self,
        node: NodeLink,
        number: int,
        config: AxisConfig,
        pdos: AxisPdos,
        clear_emergencies: Callable[[int], None],
    ) -> None:
        """`clear_emergencies` is told the axis's number when its faults were reset."""
        self.node = node
        self._clear_emergencies = clear_emergencies
        self.number = number
        self.name = config.name
        self.pdos = pdos
        self.backbone = node.backbone
        timing = self.backbone.timing
        self.configuring = False
        """Whether its settings are being written: nothing else is begun meanwhile."""
        self.unsettled = ""
        """Why its module may hold other settings than ours, until the node is taken in anew."""
        self.lives = 0
        """How often its module was lost or started anew."""
        self._owes_stop = False
        """Whether it was out of reach since it was commanded, so that it must stand before anything else."""
        self._drive = Drive(
            pdos,
            node.command,
            node.backbone.withdraw,
            timing,
            node.counters,
            self._on_status,
            self._on_silence,
        )
        parameters = DriveParameters(node.objects, number)
        current = CurrentConfig(config)
        self._tools = AxisTools(node.node_id, number, current, timing, self._drive, node.objects, parameters)
        self.id = self._tools.id
        self._activity = Activity(self._tools, self.backbone.report_bug)
        self._loss_check = LossCheck(self._tools, node.name, self._on_contradiction, self.backbone.report_bug)
        self.setup = AxisSetup(self._tools, node.establisher)
        self.backbone.sync.watch(self)

    # --- what it is and does ---

    @property
    def config(self) -> AxisConfig:
        """What it goes by now; it may be replaced while the axis stands, so read it anew each time."""
        return self._tools.config

    @property
    def status(self) -> AxisStatus:
        """The last snapshot. It ages: see `AxisStatus.stale` and `age`."""
        return self._drive.status

    @property
    def adopted(self) -> bool:
        """Whether nobody here has enabled it though it is, or was found, enabled or turning."""
        return self.status.adopted is not None

    @property
    def motion(self) -> Operation | None:
        """The motion that runs, if one does: the axis's own, or one in which it takes part.

        A turning that has its velocity is no running motion any more.
        """
        return self._activity.motion

    @property
    def last(self) -> Motion | None:
        """The motion of this axis alone that is begun last of all that was accepted; None: there is none."""
        return self._activity.last

    @property
    def queued(self) -> tuple[Motion, ...]:
        """The motions that wait for their turn, the next first."""
        return self._activity.line.motions

    @property
    def making_way(self) -> bool:
        """Whether it comes to rest because another command replaced what ran."""
        return self._activity.making_way

    @property
    def errand(self) -> ErrandName | None:
        """What the axis is busy with."""
        return self._activity.errand

    def age(self) -> float | None:
        """Seconds since the older of the two status TPDOs came; None: never."""
        updated = self.status.updated
        return None if math.isinf(updated) else asyncio.get_running_loop().time() - updated

    @property
    def heard_at(self) -> float | None:
        """Loop time of the last status TPDO; None: none since the node's last boot-up."""
        return self._drive.heard_at

    # --- what ends or joins what it does ---

    def begin_stop(self, reason: str) -> None:
        """The part of `stop` that needs no waiting: ends the motion, sends the halt, goes on in a task."""
        self._activity.cancel_motion(reason)
        if self._activity.coming_to_rest:
            return
        self._activity.give_way("a stop")
        rest = self._activity.begin_rest()
        if self.in_reach:
            self._activity.begin(ErrandName.STOPPING, rest())

    def expect(self, operation: Operation) -> None:
        """What the axis does ends, and it takes part in this then: see `take_part`."""
        self._activity.expect(operation)

    def take_part(
        self,
        operation: Operation,
        name: ErrandName,
        work: Callable[[], Work],
        guide: Guide | None = None,
    ) -> None:
        """Begin this axis's part of what several do together; it must be ready for it, and idle."""
        self._activity.take_part(operation, name, work, guide)

    async def stands(self) -> None:
        """Wait until the axis has come to rest, if that is what it is doing. Raises as `stop` does."""
        if self._activity.coming_to_rest:
            await self._activity.join_rest()

    @property
    def tools(self) -> AxisTools:
        """What a part of something larger works with."""
        return self._tools

    # --- for the SYNC: see `SyncedAxis` ---

    @property
    def node_name(self) -> str:
        """Its node's."""
        return self.node.name

    @property
    def in_reach(self) -> bool:
        """Whether its module takes PDOs, as far as is known."""
        return self.node.takes_pdo_commands

    @property
    def set_point_waits(self) -> bool:
        """Whether a set point may wait in its module for a SYNC."""
        return self._drive.prepared

    def prepare_over(self) -> None:
        """Put what changes nothing over it. Raises `BusError`."""
        self._drive.prepare_over()

    def note_taken(self) -> None:
        """Nothing waits in its module any more."""
        self._drive.note_taken()

    # --- for the node ---

    def route(self, add: Callable[[int, Callable[[Frame], None]], None]) -> None:
        """Have the status TPDOs brought here."""
        add(self.pdos.status.cob_id, self._drive.on_status_pdo)
        add(self.pdos.motion.cob_id, self._drive.on_motion_pdo)

    def seed(self, found: Found) -> None:
        """What was read by SDO before anything is written or PDOs flow."""
        self._drive.seed(*found)

    def adopt(self, adoption: Adoption | None) -> None:
        """It was compared; it was found as it says and must be claimed, or (None) needs no claim."""
        self.unsettled = ""
        self._drive.note_adoption(adoption)

    def go_by(self, config: AxisConfig) -> None:
        """Replace the configuration: by `reconfigure`, or before the network is opened, and nowhere else.

        What changes the meaning of positions loses the reference: resolution, encoder, home offset.
        """
        before, self._tools.current.value = self.config, config
        self._tools.parameters.forget()
        if self.status.referenced and _counting(before) != _counting(config):
            self._drive.note_reference(Reference.LOST)
        self._on_status(self.status)

    def distrust_status(self) -> None:
        """The status TPDOs carry something else from now on."""
        self._drive.distrust()

    async def has_status(self, seconds: float) -> bool:
        """Wait until both status TPDOs have come."""
        return await self._drive.until(lambda status: not status.stale, seconds)

    async def shows(self, condition: Condition, seconds: float) -> bool:
        """Wait until a status meets `condition`; False if none does within `seconds`."""
        return await self._drive.until(condition, seconds)

    def interrupt(self, error: CanaxisError, *, stop: bool) -> None:
        """Something outside ended what the axis did; with `stop` the halt is tried too."""
        self._activity.fail_motion(error)
        if stop and self._activity.coming_to_rest:
            return
        self._activity.abandon(error)
        if stop:
            self.begin_stop(error.message)

    def back_in_reach(self) -> None:
        """The node is operational: an axis that turns, though it was to stop meanwhile, is stopped now; what
        may wait in the module for a SYNC is made harmless.
        """
        latch = self.backbone.stop_latched
        if self.status.moving and latch is not None:
            self.begin_stop(f"A stop for everything is latched: {latch.reason}")
        elif self.status.moving and self._owes_stop:
            self.begin_stop("The axis was out of reach after it had been commanded.")
        self._owes_stop = False
        if self.backbone.sync.user is None:  # who has it now, makes it harmless at its end
            self.backbone.sync.make_harmless((self,))

    def forget(self, *, reference_lost: bool) -> None:
        """The module started anew: no reference, no parameters, nothing commanded."""
        self.lives += 1
        self._owes_stop = False
        self._tools.parameters.forget()
        self._drive.forget()
        if reference_lost:
            self._drive.note_reference(Reference.LOST)

    def lose(self) -> None:
        """The node is away: the status is old, and whether the reference holds is unknown."""
        self.lives += 1
        self._owes_stop = self._owes_stop or self._drive.controlword is not None
        self._drive.unwatch()
        self._tools.parameters.forget()
        if self.status.referenced:
            self._drive.note_reference(Reference.UNKNOWN)
        self._drive.note_stale()

    def on_emergencies(self, active: tuple[EmergencyRecord, ...], newest: EmergencyRecord | None) -> None:
        """The node's emergencies changed; a new one that is a fault ends the motion."""
        self._drive.note_emergencies(active)
        if self.motion is not None and newest is not None:
            self.motion.evidence.note(newest)
        if self.motion is None or newest is None or newest.axis != self.number:
            return
        if newest.active and newest.severity is Severity.FAULT:
            self.interrupt(self._tools.fault(self.status), stop=self.status.state not in FAULT_STATES)

    def confirm(self, record: EmergencyRecord) -> None:
        """The module lost messages: a motion goes on only if the drive shows what was commanded last."""
        if self.motion is not None:
            self._loss_check.begin(self.motion, record)

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
        await self._loss_check.close()
        self._drive.unwatch()
        self._activity.cancel_motion("The network is being closed.")
        await self._activity.close(self._away("The network is being closed"))

    # --- inside ---

    def _on_contradiction(self, motion: Operation, error: CanaxisError) -> None:
        if self.motion is motion:
            self.interrupt(error, stop=True)

    def _begin_disable(self, reason: str) -> None:
        self._activity.cancel_motion(reason)
        if self.errand is not ErrandName.DISABLING:
            self._activity.give_way("a disable")
            self._activity.begin(ErrandName.DISABLING, self._disable(self._activity.begin_rest()))

    async def _disable(self, rest: Callable[[], Work]) -> None:
        if self._drive.energised:
            await rest()
        await power.disable(self._tools)

    def _away(self, what: str) -> NodeAway:
        return NodeAway(
            f"{what}: node {self.node.name} is {self.node.state}. Whether axis {self.name} moves is unknown.",
            hint="Use the module's enable input or cut the motor supply if it must stand; check the cable.",
            **self._tools.where,
        )

    def _on_motion(self, motion: Operation) -> None:
        self.backbone.events.publish(
            "motion", node=self.node.node_id, axis=self.number, data={"motion": motion}
        )

    def _on_status(self, status: AxisStatus) -> None:
        if (motion := self.motion) is not None:
            motion.evidence.see(self.id, status)
        events = self.backbone.events
        if events.is_wanted("axis"):
            events.publish("axis", node=self.node.node_id, axis=self.number, data={"status": status})

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


def _counting(config: AxisConfig) -> tuple[object, ...]:
    """What positions are counted by."""
    gearing = config.gearing
    resolution = None if gearing is None else (gearing.full_steps, gearing.microsteps)
    return resolution, config.encoder, config.encoder_resolution, config.encoder_direction, config.home_offset
