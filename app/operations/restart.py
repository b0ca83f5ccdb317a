"""After a restart: what became of the axes of the operations that it ended."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from app.operations.register import OperationRegister
from app.operations.schemas import OperationReply
from drivers.errors import CanaxisError
from drivers.master.network import Network
from drivers.master.seen.status import NodeState


async def note_what_is_found(
    operations: OperationRegister, network: Network, interrupted: Sequence[OperationReply]
) -> None:
    """Note each axis of the interrupted operations once, when its node is operational again."""
    missing = {(axis.node, axis.axis, reply.id) for reply in interrupted for axis in reply.axes}
    events = network.events.subscribe(kinds=frozenset({"node"}))
    try:
        while missing:
            for node_id, number, operation_id in sorted(missing):
                with contextlib.suppress(CanaxisError):  # no longer configured
                    node = network.node(node_id)
                    if node.state is not NodeState.OPERATIONAL:
                        continue
                    await operations.note_found(operation_id, node.axis(number))
                missing.discard((node_id, number, operation_id))
            if missing and await events.get() is None:
                return
    finally:
        events.close()
