"""One node as its users see it: its state, its axes, its objects. What brings it up is in `supervisor`."""

from __future__ import annotations

import asyncio
import copy
from collections import deque
from collections.abc import Sequence

from drivers.bus.frame import Frame
from drivers.cia301 import cob, heartbeat, nmt
from drivers.cia301.emcy import Emergency
from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.objects import Address
from drivers.cia301.types import Value
from drivers.devices.profile import DeviceProfile, ObjectSpec
from drivers.errors import (
    CanaxisError,
    GuardedObject,
    NodeAway,
    NotReady,
    SdoTimeout,
    UnknownAxis,
)
from drivers.master.axis.axis import Axis
from drivers.master.axis.readiness import boot_obstacles
from drivers.master.ground.counters import NodeCounters
from drivers.master.ground.router import Router
from drivers.master.ground.where import Where
from drivers.master.link.backbone import Backbone
from drivers.master.link.holding import Establisher
from drivers.master.node.common import CONSUMER_HEARTBEAT
from drivers.master.node.guarded_objects import Guard, guard_of
from drivers.master.node.io import Terminals
from drivers.master.node.supervisor import NodeSupervisor
from drivers.master.node.waiting import Waits
from drivers.master.plan.boot_log import BootLog
from drivers.master.plan.configuration import AxisConfig, NodeConfig
from drivers.master.plan.pdo_plan import NodePdos
from drivers.master.sdo.answers import AnswerWatch
from drivers.master.sdo.client import Priority, SdoClient
from drivers.master.sdo.object_access import ObjectAccess
from drivers.master.seen.emergencies import EmergencyLog, EmergencyRecord
from drivers.master.seen.status import SETTLED, SWITCHED_OFF, Failsafe, NodeState, NodeStatus, Particulars

_UNCONFIRMED = frozenset({0x8110, 0x8140})
"""Emergencies after which the module may have missed what was sent to it: an overrun, a bus-off."""


class Node:
    """One module on the bus."""

    def __init__(
        self, config: NodeConfig, profile: DeviceProfile, pdos: NodePdos, backbone: Backbone
    ) -> None:
        self.node_id = config.node_id
        self.name = config.name
        self.config = config
        self.profile = profile
        self.pdos = pdos
        self.backbone = backbone
        self.counters = NodeCounters()
        self.sdo = SdoClient(
            self.node_id, backbone.send, backbone.timing, self.counters.sdo, profile.abort_remedy
        )
        self.objects = ObjectAccess(self.node_id, profile, self.sdo)
        self.answers = AnswerWatch(self.counters.sdo)
        self.boot_log = BootLog(self.publish)
        self.establisher = Establisher(self.node_id, self.objects, self.boot_log)
        self.state = NodeState.ABSENT
        self.reason = "It has not answered yet."
        self.nmt_state: NmtState | None = None
        self.failsafe = Failsafe.OFF
        self._failsafe_seen: Failsafe | None = None
        self.particulars: Particulars | None = None
        self.heartbeat_stale = False
        """Whether its heartbeat is late, though it is not yet lost."""
        self._log = EmergencyLog(self.node_id, profile.emergencies)
        self.axes = tuple(
            Axis(self, number, axis_config, axis_pdos)
            for number, (axis_config, axis_pdos) in enumerate(
                zip(_axis_configs(config, profile), pdos.axes, strict=True)
            )
        )
        self.terminals = Terminals(self)
        self.waits = Waits(self)
        self.supervisor = NodeSupervisor(self)

    # --- for its users ---

    def axis(self, ref: int | str) -> Axis:
        """An axis by number or name. Raises `UnknownAxis`."""
        for axis in self.axes:
            if ref in (axis.number, str(axis.number), axis.name):
                return axis
        raise UnknownAxis(f"Node {self.name} has no axis {ref!r}.", node=self.node_id)

    @property
    def emergencies(self) -> deque[EmergencyRecord]:
        """The history, oldest first; bounded."""
        return self._log.history

    def status(self) -> NodeStatus:
        """A snapshot."""
        heard = self.supervisor.heard_at
        particulars = self.particulars
        return NodeStatus(
            state=self.state,
            reason=self.reason,
            nmt_state=self.nmt_state,
            identity=particulars.identity if particulars else None,
            device_name=particulars.device_name if particulars else "",
            hardware_version=particulars.hardware_version if particulars else "",
            software_version=particulars.software_version if particulars else "",
            serial=particulars.identity.serial if particulars else None,
            failsafe=self.failsafe,
            heartbeat_age_s=None if heard is None else asyncio.get_running_loop().time() - heard,
            emergencies=self._log.all_active(),
            boot=self.boot_log.steps,
            counters=copy.deepcopy(self.counters),
        )

    def spec(self, index: int, sub: int) -> ObjectSpec:
        """What the profile says of an object, by the index that the wire sees. Raises `UnknownObject`."""
        return self.objects.spec(Address(index, sub))

    async def read(self, address: Address) -> Value:
        """Read an object; an unanswered read is tried once more.

        Raises `UnknownObject`, `NodeAway`, `SdoError`.
        """
        self.objects.spec(address)
        self._require_answering()
        try:
            return await self.objects.read(address)
        except SdoTimeout:
            return await self.objects.read(address)

    async def write(self, address: Address, value: Value, *, confirm: bool = False) -> None:
        """Write an object past the commands, once.

        Raises `GuardedObject` where the object is never written so, or needs `confirm` and all axes switched
        off; `UnknownObject`, `BadValue`, `NodeAway`, `SdoError`.
        """
        self._check_guard(address, confirm=confirm)
        self.objects.encoded(self.objects.spec(address), value)
        self._require_answering()
        try:
            await self.objects.write(address, value, priority=Priority.MONITOR)
        finally:
            for axis in self.axes:
                axis.parameter_written(address.index, address.sub)

    async def boot(self) -> None:
        """Take the node in anew, now: identify it, compare, write what differs. Resets and enables nothing.

        Returns once it is operational. Raises `NotReady` while an axis of an operational node is in use or
        switched on, else what prevents it: `NodeAway`, `WrongIdentity`, `DuplicateNode`,
        `ConfigurationRefused`, `SdoError`, `BusError`.
        """
        found = tuple(boot_obstacles(self))
        if found:
            reasons = " ".join(obstacle.message for obstacle in found)
            raise NotReady(
                f"Node {self.name} can't be taken in anew now: {reasons}", obstacles=found, node=self.node_id
            )
        await self.supervisor.take_in_now()

    # --- for the network and the supervisor ---

    def route(self, router: Router) -> None:
        """Have the node's frames brought here."""
        router.add(cob.heartbeat(self.node_id), self._on_heartbeat)
        router.add(cob.emcy(self.node_id), self._on_emergency)
        router.add(cob.sdo_response(self.node_id), self._on_sdo_answer)
        router.add(cob.sdo_request(self.node_id), self._on_foreign_request)
        for axis in self.axes:
            axis.route(router.add)

    def energised_after(self, moment: float) -> bool:
        """Whether an axis said after that loop time that it holds its motor, or is about to."""
        return any(
            axis.heard_at is not None
            and axis.heard_at > moment
            and axis.status.state is not None
            and axis.status.state not in SWITCHED_OFF
            for axis in self.axes
        )

    @property
    def takes_pdo_commands(self) -> bool:
        """Whether its PDOs flow, as far as is known. Those of a duplicate do, at least of one of the two."""
        return self.state in (NodeState.OPERATIONAL, NodeState.DUPLICATE)

    @property
    def takes_sdo_commands(self) -> bool:
        """Whether it is the configured module and answers, though its PDOs may not flow."""
        away = (NodeState.ABSENT, NodeState.LOST, NodeState.DUPLICATE)
        return self.particulars is not None and self.state not in away

    def enter(self, state: NodeState, reason: str = "") -> None:
        """Change the state and say so."""
        self.state, self.reason = state, reason
        self.publish()

    def publish(self) -> None:
        """Tell the subscribers how the node is."""
        events = self.backbone.events
        if events.is_wanted("node"):
            events.publish("node", node=self.node_id, data={"status": self.status()})

    def command_nmt(self, command: NmtCommand) -> None:
        """Send an NMT command to this node. Raises `BusError`."""
        self.command(Frame(cob.NMT, nmt.encode(command, self.node_id)), True)

    def command(self, frame: Frame, urgent: bool) -> None:
        """Send what changes the node past its SDO channel. Raises `BusError`."""
        self.sdo.note_command()
        self.backbone.send(frame, urgent)

    def interrupt(self, error: CanaxisError, *, stop: bool) -> None:
        """End what every axis does, and what is waited for."""
        self.waits.fail(error)
        for axis in self.axes:
            axis.interrupt(error, stop=stop)

    def clear_emergencies(self, axis: int | None) -> None:
        """The faults of an axis were reset."""
        self._log.clear(axis)
        self._tell_axes(None)

    def note_armed(self, armed: Failsafe) -> None:
        """The fail-safe was configured; what a check found since the last boot-up goes on counting."""
        self.failsafe = armed if self._failsafe_seen is None else self._failsafe_seen

    def note_failsafe(self, seen: Failsafe) -> Failsafe:
        """A check has shown whether the fail-safe works."""
        self.failsafe = self._failsafe_seen = seen
        self.publish()
        return seen

    def forget(self) -> None:
        """The module started anew: nothing that it held or said before counts."""
        self._failsafe_seen = None
        self.answers.forget()
        self._log.clear_all()
        self._tell_axes(None)
        known = self.particulars is not None
        for axis in self.axes:
            axis.forget(reference_lost=known)

    def is_away(self, what: str) -> NodeAway:
        """The error for what can't be done without the node."""
        return NodeAway(f"Node {self.name}: {what}", node=self.node_id)

    async def release(self) -> None:
        """Take leave of a node whose axes are off: then the end of our heartbeat is no error to it (1016h).

        It is left in Pre-operational. A node that is not seen to be off, or does not answer, keeps its watch.
        """
        off = all(axis.status.state in SWITCHED_OFF and not axis.status.stale for axis in self.axes)
        if self.state is not NodeState.OPERATIONAL or not off:
            return
        try:
            await self.objects.write(CONSUMER_HEARTBEAT, 0, priority=Priority.CONTROL)
            self.command_nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
        except CanaxisError:
            return  # it will see our heartbeat end, and stand all the same

    async def close(self) -> None:
        """End every task."""
        await self.supervisor.close()
        await self.waits.close()
        self.sdo.close()
        for axis in self.axes:
            await axis.close()

    # --- inside ---

    def _on_heartbeat(self, frame: Frame) -> None:
        state = heartbeat.decode(frame.data)
        if state is None:
            self.counters.malformed_heartbeats += 1
            return
        if state is NmtState.BOOT_UP:
            self.counters.boot_ups += 1
        else:
            self.counters.heartbeats += 1
        self.nmt_state = NmtState.PRE_OPERATIONAL if state is NmtState.BOOT_UP else state
        self.supervisor.heard(state)

    def _on_sdo_answer(self, frame: Frame) -> None:
        self.sdo.on_frame(frame)
        self.answers.look()
        if self.answers.duplicate and self.state in SETTLED:
            self.supervisor.duplicated("Each of its SDO requests is answered twice: two nodes have this ID.")

    def _on_foreign_request(self, _: Frame) -> None:
        """Another master asks this node; its own requests no bus brings back to us."""
        self.counters.foreign_requests += 1
        self.answers.forget()

    def _on_emergency(self, frame: Frame) -> None:
        emergency = Emergency.decode(frame.data)
        if emergency is None:
            self.counters.malformed_emergencies += 1
            return
        self.counters.emergencies += 1
        record = self._log.record(emergency)
        self.backbone.events.publish(
            "emergency", node=self.node_id, axis=record.axis, data={"record": record}
        )
        self._tell_axes(record)
        if emergency.code in _UNCONFIRMED:
            self._distrust(record)

    def _distrust(self, record: EmergencyRecord) -> None:
        """The module lost messages: a command that was just given counts as unconfirmed."""
        for axis in self.axes:
            axis.confirm(record)

    def _tell_axes(self, newest: EmergencyRecord | None) -> None:
        for axis in self.axes:
            if newest is None or newest.axis is None or newest.axis == axis.number:
                axis.on_emergencies(self._log.active(axis.number), newest)

    def _require_answering(self) -> None:
        if self.state in (NodeState.ABSENT, NodeState.LOST):
            raise NodeAway(f"Node {self.name} is {self.state}: {self.reason}", node=self.node_id)

    def _check_guard(self, address: Address, *, confirm: bool) -> None:
        where: Where = {"node": self.node_id, "index": address.index, "sub": address.sub}
        guard = guard_of(address.index, self.profile.layout)
        if guard is Guard.NEVER:
            raise GuardedObject(
                f"{address} is never written past the axis's commands.",
                hint="Use the axis's commands: enable, disable, move, velocity, home, stop.",
                **where,
            )
        if self.state is NodeState.DUPLICATE or self.state is NodeState.REFUSED:
            raise GuardedObject(
                f"Nothing is written to node {self.name}, which is {self.state}: {self.reason}",
                hint="Put right what the reason names; then the node is identified anew.",
                **where,
            )
        if guard is Guard.FREE:
            return
        if not confirm:
            raise GuardedObject(
                f"Writing {address} can endanger motion, or the service's hold on the node.",
                hint="Confirm the write if it is meant, with every axis of the node disabled.",
                **where,
            )
        energised = [axis.name for axis in self.axes if axis.status.state not in SWITCHED_OFF]
        if energised:
            raise GuardedObject(
                f"{address} is only written while every axis of node {self.name} is disabled; "
                f"{', '.join(energised)} may not be.",
                hint="Disable every axis of the node first.",
                **where,
            )


def _axis_configs(config: NodeConfig, profile: DeviceProfile) -> Sequence[AxisConfig]:
    configured = config.axes[: profile.axes]
    missing = range(len(configured), profile.axes)
    return (*configured, *(AxisConfig(name=f"axis{number}") for number in missing))
