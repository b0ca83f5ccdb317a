"""What happens on the bus, into the log: nodes, emergencies with cause and remedy, motions, stops."""

from __future__ import annotations

from typing import cast

import structlog

from drivers.master.motions.motion import MotionState, Operation
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.events import Event, Subscription
from drivers.master.seen.status import NodeState, NodeStatus

KINDS = frozenset({"bus", "emergency", "motion", "node", "stop"})
"""All but the axes' statuses, which come with every PDO, and the leases, whose keeper writes the log."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.journal")


async def keep_journal(events: Subscription) -> None:
    """Write down what a subscription to `KINDS` brings, until it is closed."""
    states: dict[int | None, NodeState] = {}
    async for event in events:
        match event.kind:
            case "node":
                status = cast("NodeStatus", event.data["status"])
                if states.get(event.node) is not status.state:
                    states[event.node] = status.state
                    _node(event, status)
            case "emergency":
                _emergency(cast("EmergencyRecord", event.data["record"]))
            case "motion":
                _motion(event, cast("Operation", event.data["motion"]))
            case "stop" if event.data["latched"]:
                log.warning("everything is told to stop", reason=event.data["reason"])
            case "stop":
                log.info("the stop is reset")
            case "bus":
                state = str(event.data["state"])
                tell = log.info if state == "active" else log.warning
                tell("bus", state=state, reason=event.data["reason"])
            case _:
                log.warning("the journal could not keep up", **event.data)


def _node(event: Event, status: NodeStatus) -> None:
    bad = status.state in (NodeState.LOST, NodeState.REFUSED, NodeState.DUPLICATE)
    tell = log.warning if bad else log.info
    tell("node", node=event.node, state=status.state.value, reason=status.reason)


def _emergency(record: EmergencyRecord) -> None:
    code = f"{record.code:04X}h"
    if record.active:
        log.warning(
            record.title,
            node=record.node,
            axis=record.axis,
            code=code,
            cause=record.cause,
            remedy=record.remedy,
        )
    else:
        log.info(record.title, node=record.node, axis=record.axis, code=code)


def _motion(event: Event, motion: Operation) -> None:
    if not motion.done:
        return
    tell = log.warning if motion.state is MotionState.FAILED else log.info
    error = None if motion.error is None else motion.error.message
    tell(
        "motion ended",
        node=event.node,
        axis=event.axis,
        kind=motion.kind.value,
        state=motion.state.value,
        error=error,
    )
