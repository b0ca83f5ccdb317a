"""One node as its axes know it: who it is, how far it is, and the way to it.

It knows no axis. What a node does with its axes is added above, by `node.body` and `node.node`.
"""

from __future__ import annotations

import asyncio
import copy
from collections import deque

from drivers.bus.frame import Frame
from drivers.cia301 import cob, nmt
from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.objects import Address
from drivers.cia301.types import Value
from drivers.devices.profile import DeviceProfile, ObjectSpec
from drivers.errors import NodeAway, SdoTimeout
from drivers.master.ground.counters import NodeCounters
from drivers.master.link.backbone import Backbone
from drivers.master.link.holding import Establisher
from drivers.master.plan.configuration import NodeConfig
from drivers.master.sdo.client import SdoClient
from drivers.master.sdo.object_access import ObjectAccess
from drivers.master.seen.boot_log import BootLog
from drivers.master.seen.emergencies import EmergencyLog, EmergencyRecord
from drivers.master.seen.status import Failsafe, NodeState, NodeStatus, Particulars


class NodeLink:
    """What is known of one module, and its channels."""

    def __init__(self, config: NodeConfig, profile: DeviceProfile, backbone: Backbone) -> None:
        self.node_id = config.node_id
        self.name = config.name
        self.config = config
        self.profile = profile
        self.backbone = backbone
        self.counters = NodeCounters()
        self.sdo = SdoClient(
            self.node_id, backbone.send, backbone.timing, self.counters.sdo, profile.abort_remedy
        )
        self.objects = ObjectAccess(self.node_id, profile, self.sdo)
        self.boot_log = BootLog(self.publish)
        self.establisher = Establisher(self.node_id, self.objects, self.boot_log)
        self.state = NodeState.ABSENT
        self.reason = "It has not answered yet."
        self.nmt_state: NmtState | None = None
        self.failsafe = Failsafe.OFF
        self._failsafe_seen: Failsafe | None = None
        self.particulars: Particulars | None = None
        self.heard_at: float | None = None
        """Loop time of the last heartbeat or boot-up."""
        self.operational_at: float | None = None
        """Loop time of the last heartbeat that said Operational."""
        self.heartbeat_stale = False
        """Whether its heartbeat is late, though it is not yet lost."""
        self._log = EmergencyLog(self.node_id, profile.emergencies)

    # --- how it is ---

    @property
    def emergencies(self) -> deque[EmergencyRecord]:
        """The history, oldest first; bounded."""
        return self._log.history

    def status(self) -> NodeStatus:
        """A snapshot."""
        heard = self.heard_at
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

    @property
    def takes_pdo_commands(self) -> bool:
        """Whether its PDOs flow, as far as is known. Those of a duplicate do, at least of one of the two."""
        return self.state in (NodeState.OPERATIONAL, NodeState.DUPLICATE)

    @property
    def takes_sdo_commands(self) -> bool:
        """Whether it is the configured module and answers, though its PDOs may not flow."""
        away = (NodeState.ABSENT, NodeState.LOST, NodeState.DUPLICATE)
        return self.particulars is not None and self.state not in away

    def require_operational(self) -> None:
        """Raise `NodeAway` while it is not: what another module, or none, holds is none of ours."""
        if self.state is not NodeState.OPERATIONAL:
            raise NodeAway(f"Node {self.name} is {self.state}: {self.reason}", node=self.node_id)

    def is_away(self, what: str) -> NodeAway:
        """The error for what can't be done without the node."""
        return NodeAway(f"Node {self.name}: {what}", node=self.node_id)

    def enter(self, state: NodeState, reason: str = "") -> None:
        """Change the state and say so."""
        self.state, self.reason = state, reason
        self.publish()

    def publish(self) -> None:
        """Tell the subscribers how the node is."""
        events = self.backbone.events
        if events.is_wanted("node"):
            events.publish("node", node=self.node_id, data={"status": self.status()})

    def note_armed(self, armed: Failsafe) -> None:
        """The fail-safe was configured; what a check found since the last boot-up goes on counting."""
        self.failsafe = armed if self._failsafe_seen is None else self._failsafe_seen

    def note_failsafe(self, seen: Failsafe) -> Failsafe:
        """A check has shown whether the fail-safe works."""
        self.failsafe = self._failsafe_seen = seen
        self.publish()
        return seen

    # --- the way to it ---

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

    def command_nmt(self, command: NmtCommand) -> None:
        """Send an NMT command to this node. Raises `BusError`."""
        self.command(Frame(cob.NMT, nmt.encode(command, self.node_id)), True)

    def command(self, frame: Frame, urgent: bool) -> None:
        """Send what changes the node past its SDO channel. Raises `BusError`."""
        self.sdo.note_command()
        self.backbone.send(frame, urgent)

    def _require_answering(self) -> None:
        if self.state in (NodeState.ABSENT, NodeState.LOST):
            raise NodeAway(f"Node {self.name} is {self.state}: {self.reason}", node=self.node_id)
