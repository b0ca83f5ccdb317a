"""What the streams say: a snapshot of everything, and each event in the shapes of the replies to GET."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from typing import Any, cast

from app.axes import views as axes
from app.bus import views as bus
from app.bus.opening import BusOpener
from app.leases.leases import Leases
from app.nodes import views as nodes
from app.operations.register import OperationRegister
from app.stop import views as stop
from drivers.master.motions.motion import Operation
from drivers.master.network import Network
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.events import Event


@dataclass(frozen=True, slots=True)
class Told:
    """The parts of the service that the streams tell of."""

    network: Network
    bus: BusOpener
    leases: Leases
    operations: OperationRegister

    def snapshot(self) -> dict[str, Any]:
        """Everything at once, for the beginning of a stream."""
        there = self.network.nodes.values()
        return {
            "time": datetime.now(UTC),
            "bus": bus.bus(self.bus).model_dump(mode="json"),
            "stop": stop.stop(self.network.stop_latched).model_dump(mode="json"),
            "nodes": [nodes.node(node).model_dump(mode="json") for node in there],
            "axes": [
                axes.axis_status(axis, self.leases).model_dump(mode="json")
                for node in there
                for axis in node.axes
            ],
            "leases": [self.leases.reply(lease).model_dump(mode="json") for lease in self.leases.all()],
            "operations": [
                operation.reply().model_dump(mode="json") for operation in self.operations.running()
            ],
        }

    def news(self, event: Event) -> dict[str, Any]:
        """What an event says, besides when it was and what it is about."""
        if event.kind == "axis" and event.node is not None and event.axis is not None:
            axis = self.network.node(event.node).axis(event.axis)
            return axes.axis_status(axis, self.leases).model_dump(mode="json")
        if event.kind == "node" and event.node is not None:
            return nodes.node(self.network.node(event.node)).model_dump(mode="json")
        if event.kind == "emergency" and isinstance(record := event.data["record"], EmergencyRecord):
            return nodes.emergency(record).model_dump(mode="json", by_alias=True)
        if event.kind == "motion" and isinstance(motion := event.data["motion"], Operation):
            return self.operations.reply_for(motion).model_dump(mode="json")
        return {key: _plain(value) for key, value in event.data.items()}  # bus, lease, stop


def _plain(value: object) -> object:
    """A value of an event as JSON knows it."""
    if isinstance(value, Enum):
        return _plain(value.value)
    if value is None or isinstance(value, str | int | float | bool | datetime):
        return value
    if isinstance(value, bytes):
        return value.hex(" ")
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in cast("Mapping[object, object]", value).items()}
    if isinstance(value, Sequence):
        return [_plain(item) for item in cast("Sequence[object]", value)]
    return str(value)
