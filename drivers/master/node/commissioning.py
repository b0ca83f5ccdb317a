"""The check that a module really stops its motors when our heartbeat ends (1016h, 1029h; manual §3.1.11,
§3.1.14).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

from drivers.cia402.power import PowerState
from drivers.errors import NotReady, Obstacle, TransitionTimeout
from drivers.master.axis.axis import Axis
from drivers.master.node.body import NodeBody
from drivers.master.seen.status import Failsafe, NodeState
from drivers.obstacles import AWAY_FOR_CHECK, AXIS_DISTURBS_CHECK, CHECK_RUNS, NOTHING_TO_CHECK

HEARTBEAT_LOST = 0x8130
"""The emergency with which a module says that it missed our heartbeat (manual §11.2)."""
_SLACK = 1.0
"""Seconds on top of 1016h for the emergency to come."""
_POLL = 0.02


async def verify_failsafe(
    node: NodeBody, everybody: Iterable[Axis], pause: Callable[[], None], resume: Callable[[], None]
) -> Failsafe:
    """Let our heartbeat pause while the axes stand, and see whether the node faults its enabled ones.

    The pause is heard by every node of the bus, so every axis of `everybody` must stand; those that are
    enabled will be in FAULT afterwards. Raises `NotReady` before anything is done, `TransitionTimeout` if the
    node does not come back. Returns `VERIFIED`, or `OFF` where the node went on as if nothing had happened.
    """
    obstacles = tuple(_obstacles(node, everybody))
    if obstacles:
        reasons = " ".join(obstacle.message for obstacle in obstacles)
        raise NotReady(
            f"The fail-safe of node {node.name} can't be checked now: {reasons}",
            obstacles=obstacles,
            node=node.node_id,
        )
    enabled = [axis for axis in node.axes if axis.status.state is PowerState.OPERATION_ENABLED]
    known = {record.id for record in node.emergencies}
    pause()
    try:
        told = await _within(
            lambda: any(r.code == HEARTBEAT_LOST for r in node.emergencies if r.id not in known),
            node.backbone.config.consumer_ms / 1000 + _SLACK,
        )
    finally:
        resume()
    await _within(lambda: node.state is not NodeState.OPERATIONAL, _SLACK)
    if not await _within(lambda: _is_back(node), 10 * _SLACK):
        raise TransitionTimeout(
            f"Node {node.name} did not come back after the check of its fail-safe.", node=node.node_id
        )
    faulted = all(axis.status.state is PowerState.FAULT for axis in enabled)
    return node.note_failsafe(Failsafe.VERIFIED if told and faulted else Failsafe.OFF)


def _is_back(node: NodeBody) -> bool:
    return node.state is NodeState.OPERATIONAL and not any(axis.errand for axis in node.axes)


def _obstacles(node: NodeBody, everybody: Iterable[Axis]) -> Iterable[Obstacle]:
    if node.state is not NodeState.OPERATIONAL:
        yield AWAY_FOR_CHECK.found(f"It is {node.state}.")
    if node.backbone.heartbeat_paused:
        yield CHECK_RUNS.found("Another check is under way.")
    if not any(axis.status.state is PowerState.OPERATION_ENABLED for axis in node.axes):
        yield NOTHING_TO_CHECK.found("None of its axes is enabled.")
    for axis in everybody:
        if axis.status.moving or axis.errand is not None:
            yield AXIS_DISTURBS_CHECK.found(f"Axis {axis.name} of {axis.node.name} is in use.")


async def _within(condition: Callable[[], bool], seconds: float) -> bool:
    """Whether a condition came true in time. Looked at, since three different things may make it true."""
    loop = asyncio.get_running_loop()
    deadline = loop.time() + seconds
    while not condition():
        if loop.time() > deadline:
            return False
        await asyncio.sleep(_POLL)
    return True
