"""Whether everything that is configured can be commanded, and what else should be put right."""

from __future__ import annotations

from dataclasses import dataclass

from app.access.audit import AuditTrail
from app.bus.opening import BusOpener
from app.http.tasks import Tasks
from app.store.database import Database
from drivers.master.network import Network
from drivers.master.seen.status import NodeState


@dataclass(frozen=True, slots=True)
class Condition:
    """Looks at the parts that may be out of order."""

    network: Network
    bus: BusOpener
    tasks: Tasks
    store: Database
    audit: AuditTrail

    def reasons(self) -> list[str]:
        """Why the service is not ready; empty if it is."""
        reasons: list[str] = []
        bus = self.network.bus_status()
        if self.network.failure is not None:
            reasons.append("The service failed unexpectedly; its log says more.")
        if self.tasks.closing:
            reasons.append("The service is shutting down.")
        if self.bus.problem is not None:
            reasons.append(f"The bus is not open: {self.bus.problem}")
        elif not bus.state.can_send:
            reasons.append(f"The bus is {bus.state.value}: {bus.reason}")
        for node in self.network.nodes.values():
            status = node.status()
            if status.state is not NodeState.OPERATIONAL:
                reasons.append(
                    f"Node {node.node_id} ({node.name}) is {status.state.value}. {status.reason}".strip()
                )
        return reasons

    def warnings(self) -> list[str]:
        """What prevents no command, but should be put right."""
        warnings: list[str] = []
        if not (history := self.store.health).on:
            warnings.append(f"History is off: {history.reason}")
        if (problem := self.audit.problem) is not None:
            warnings.append(f"The record of commands is off: {problem}")
        return warnings
