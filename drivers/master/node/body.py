"""One node as its supervisor has it: with its axes, its inputs and outputs, and what ends what they do."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.devices.profile import DeviceProfile
from drivers.errors import CanaxisError
from drivers.master.axis.axis import Axis
from drivers.master.link.backbone import Backbone
from drivers.master.link.node_link import NodeLink
from drivers.master.node.io import NodeIo
from drivers.master.node.waiting import Waits
from drivers.master.plan.configuration import AxisConfig, NodeConfig
from drivers.master.plan.pdo_plan import NodePdos
from drivers.master.sdo.answers import AnswerWatch
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.status import SWITCHED_OFF


class NodeBody(NodeLink):
    """What a node is without anybody who takes it in; `Node` adds that, and what its users ask."""

    def __init__(
        self, config: NodeConfig, profile: DeviceProfile, pdos: NodePdos, backbone: Backbone
    ) -> None:
        super().__init__(config, profile, backbone)
        self.pdos = pdos
        self.answers = AnswerWatch(self.counters.sdo)
        self.axes = tuple(
            Axis(self, number, axis_config, axis_pdos, self.clear_emergencies)
            for number, (axis_config, axis_pdos) in enumerate(
                zip(_axis_configs(config, profile), pdos.axes, strict=True)
            )
        )
        self.terminals = NodeIo(self, [axis.name for axis in self.axes])
        self.waits = Waits(self)

    def energised_after(self, moment: float) -> bool:
        """Whether an axis said after that loop time that it holds its motor, or is about to."""
        return any(
            axis.heard_at is not None
            and axis.heard_at > moment
            and axis.status.state is not None
            and axis.status.state not in SWITCHED_OFF
            for axis in self.axes
        )

    def interrupt(self, error: CanaxisError, *, stop: bool) -> None:
        """End what every axis does, and what is waited for."""
        self.waits.fail(error)
        for axis in self.axes:
            axis.interrupt(error, stop=stop)

    def clear_emergencies(self, axis: int | None) -> None:
        """The faults of an axis were reset."""
        self._log.clear(axis)
        self._tell_axes(None)

    def forget(self) -> None:
        """The module started anew: nothing that it held or said before counts."""
        self._failsafe_seen = None
        self.answers.forget()
        self._log.clear_all()
        self._tell_axes(None)
        known = self.particulars is not None
        for axis in self.axes:
            axis.forget(reference_lost=known)

    def _tell_axes(self, newest: EmergencyRecord | None) -> None:
        for axis in self.axes:
            if newest is None or newest.axis is None or newest.axis == axis.number:
                axis.on_emergencies(self._log.active(axis.number), newest)


def _axis_configs(config: NodeConfig, profile: DeviceProfile) -> Sequence[AxisConfig]:
    configured = config.axes[: profile.axes]
    missing = range(len(configured), profile.axes)
    return (*configured, *(AxisConfig(name=f"axis{number}") for number in missing))
