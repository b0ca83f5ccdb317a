"""One node as its users see it: commands to it as a whole, and what its frames bring.

What brings it up is in `supervisor`.
"""

from __future__ import annotations

from drivers.bus.frame import Frame
from drivers.cia301 import cob, heartbeat
from drivers.cia301.emcy import Emergency
from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.objects import Address
from drivers.cia301.types import Value
from drivers.devices.profile import DeviceProfile
from drivers.errors import CanaxisError, GuardedObject, NotReady, UnknownAxis
from drivers.master.axis.axis import Axis
from drivers.master.ground.router import Router
from drivers.master.ground.where import Where
from drivers.master.link.backbone import Backbone
from drivers.master.node.body import NodeBody
from drivers.master.node.boot import boot_obstacles
from drivers.master.node.common import CONSUMER_HEARTBEAT
from drivers.master.node.guarded_objects import Guard, guard_of
from drivers.master.node.supervisor import NodeSupervisor
from drivers.master.plan.configuration import NodeConfig
from drivers.master.plan.pdo_plan import NodePdos
from drivers.master.sdo.client import Priority
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.status import SETTLED, SWITCHED_OFF, NodeState

_UNCONFIRMED = frozenset({0x8110, 0x8140})
"""Emergencies after which the module may have missed what was sent to it: an overrun, a bus-off."""


class Node(NodeBody):
    """One module on the bus."""

    def __init__(
        self, config: NodeConfig, profile: DeviceProfile, pdos: NodePdos, backbone: Backbone
    ) -> None:
        super().__init__(config, profile, pdos, backbone)
        self.supervisor = NodeSupervisor(self)

    # --- for its users ---

    def axis(self, ref: int | str) -> Axis:
        """An axis by number or name. Raises `UnknownAxis`."""
        for axis in self.axes:
            if ref in (axis.number, str(axis.number), axis.name):
                return axis
        raise UnknownAxis(f"Node {self.name} has no axis {ref!r}.", node=self.node_id)

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

    # --- for the network ---

    def route(self, router: Router) -> None:
        """Have the node's frames brought here."""
        router.add(cob.heartbeat(self.node_id), self._on_heartbeat)
        router.add(cob.emcy(self.node_id), self._on_emergency)
        router.add(cob.sdo_response(self.node_id), self._on_sdo_answer)
        router.add(cob.sdo_request(self.node_id), self._on_foreign_request)
        for axis in self.axes:
            axis.route(router.add)

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

    # --- what its frames bring ---

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

    # --- inside ---

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
