"""Boot-up of one node in the manner of CiA 302: who it is, what it does, what it lacks, and its start.

Everything is compared first and only the differences are written. A node that holds everything and runs is
therefore taken over without a write and without an NMT command that would end its watch over our heartbeat.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator

from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.errors import NodeAway, Obstacle
from drivers.master.axis.axis import Axis
from drivers.master.drive.setup import is_running
from drivers.master.node import common
from drivers.master.node.body import NodeBody
from drivers.master.node.identity import identify
from drivers.master.seen.boot_log import BootStepName
from drivers.master.seen.status import SWITCHED_OFF, Adoption, AxisStatus, NodeState
from drivers.obstacles import CLOSES, CLOSING, IN_USE

_START_TRIES = 4


def boot_obstacles(node: NodeBody) -> Iterator[Obstacle]:
    """What prevents taking a node in anew: an operational one's axes must be idle and off.

    A node that is not operational has nothing to lose by it, since nothing is reset.
    """
    if node.backbone.closing:
        yield CLOSING.found(CLOSES)
    if node.state is not NodeState.OPERATIONAL:
        return
    for axis in node.axes:
        used = axis.errand or ("being given other settings" if axis.configuring else None)
        if used is not None or axis.status.moving or axis.status.state not in SWITCHED_OFF:
            yield IN_USE.found(f"Axis {axis.name} is {used or axis.status.state or 'in no known state'}.")


async def boot_up(node: NodeBody) -> None:
    """From an answer to operational; each step's outcome is in `node.boot_log`.

    Raises `WrongIdentity`, `DuplicateNode`, `ConfigurationRefused`, `BadValue`, `UnknownObject`, `NodeAway`,
    `SdoError` or `BusError`; the step that raised it says so.
    """
    log, config = node.boot_log, node.backbone.config
    log.clear()
    node.enter(NodeState.BOOTED, "It answers; it is being identified.")
    with log.step(BootStepName.IDENTITY):
        node.particulars = await identify(node.node_id, node.name, node.profile, node.objects, node.answers)
    node.enter(NodeState.IDENTIFIED, "It is being configured.")
    with log.step(BootStepName.AXES):
        found = [await _look_at(axis) for axis in node.axes]
    with log.step(BootStepName.HEARTBEATS):
        node.note_armed(await common.exchange_heartbeats(node.establisher, config))
        log.note(f"Fail-safe: {node.failsafe}.")
    with log.step(BootStepName.PARAMETERS):
        for axis, one in zip(node.axes, found, strict=True):
            await _set_parameters(axis, one)
    with log.step(BootStepName.PDOS):
        running = any(is_running(one.statusword) for one in found)
        remapped = await _establish_pdos(node, keep_operational=running)
    node.enter(NodeState.CONFIGURED, "It is being started.")
    with log.step(BootStepName.START):
        if not remapped and not any(axis.status.stale for axis in node.axes):
            log.skip("It is operational already: no NMT command was sent.")
        else:
            await _start(node)
        node.nmt_state = NmtState.OPERATIONAL
    with log.step(BootStepName.STATUS):
        await _status_of_every_axis(node)


async def _look_at(axis: Axis) -> AxisStatus:
    """As it was found, whatever its status PDOs say from now on."""
    log = axis.node.boot_log
    axis.seed(await axis.setup.look())
    found = axis.status
    log.note(
        f"{axis.name}: {found.state or 'in no known state'}, mode {found.mode.short}, "
        f"{'turning' if found.moving else 'standing'} at {found.position} steps, {found.velocity} steps/s."
    )
    return found


async def _set_parameters(axis: Axis, found: AxisStatus) -> None:
    unclaimed = await axis.setup.configure(found.statusword)
    axis.adopt(Adoption.of(found, unclaimed) if unclaimed else None)
    if unclaimed:
        axis.node.boot_log.note(f"{axis.name} is adopted: only what matters to its stopping was compared.")


async def _establish_pdos(node: NodeBody, *, keep_operational: bool) -> bool:
    """Whether a PDO had to be mapped anew.

    Outside NMT Operational nothing watches our heartbeat, so a node with a running axis is kept in it: each
    PDO is switched off alone while it is changed.
    """
    planned = (pdo for pdos in node.pdos.axes for pdo in pdos)
    differences = await common.compare_pdos(node.establisher, planned)
    if not differences:
        node.boot_log.note("Every PDO is as it is planned.")
        return False
    if not keep_operational:
        node.command_nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
    for difference in differences:
        await common.remap(node.establisher, difference)
    for axis in node.axes:
        axis.distrust_status()  # what came under another mapping meant something else
    node.boot_log.note(f"{len(differences)} PDOs were not as they are planned.")
    return True


async def _start(node: NodeBody) -> None:
    """NMT start, repeated as it is a level. No PDO flows outside Operational, so a status is proof too."""
    each = node.backbone.timing.nmt_change / 2
    for _ in range(_START_TRIES):
        sent = asyncio.get_running_loop().time()
        node.command_nmt(NmtCommand.START)
        if await node.axes[0].has_status(each) or (node.operational_at or -math.inf) > sent:
            return
    raise NodeAway(
        f"Node {node.name} did not go to NMT Operational within {_START_TRIES * each:g} s.",
        hint="Check that no second master commands it; it is tried again later.",
        node=node.node_id,
    )


async def _status_of_every_axis(node: NodeBody) -> None:
    patience = 5 * node.backbone.timing.pdo_event_timer
    for axis in node.axes:
        if not await axis.has_status(patience):
            raise NodeAway(
                f"Node {node.name} was started, but the status of axis {axis.name} does not come.",
                hint="Check that nothing else on the bus uses the same COB-IDs.",
                node=node.node_id,
                axis=axis.number,
            )
