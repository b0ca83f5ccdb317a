"""What takes a node in and watches over it: absent, booted, identified, configured, operational; and back.

One task per node, so that no node's trouble delays another's. The router calls `heard` synchronously;
whatever that changes about the node is done at once, and the task then starts over from looking for the node.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING

from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.types import DataType
from drivers.errors import (
    BadValue,
    BusError,
    CanaxisError,
    ConfigurationRefused,
    NodeAway,
    SdoAborted,
    SdoError,
    UnknownObject,
    WrongIdentity,
)
from drivers.master import configure
from drivers.master.identify import DEVICE_TYPE, DuplicateNode, identify
from drivers.master.sdo_client import Priority
from drivers.master.status import NodeState
from drivers.master.watch import Watchdog

if TYPE_CHECKING:
    from drivers.master.node import Node

_SETTLED = frozenset({NodeState.CONFIGURED, NodeState.OPERATIONAL})


class NodeSupervisor:
    """Brings one node up and notices when it goes."""

    def __init__(self, node: Node) -> None:
        self._node = node
        backbone = node.backbone
        self._timing = backbone.timing
        period = self._heartbeat_period = backbone.config.node_heartbeat_ms / 1000
        grace = self._timing.loop_grace
        self._stale = Watchdog(period * self._timing.heartbeat_stale, grace, self._on_stale)
        self._lost = Watchdog(period * self._timing.heartbeat_lost, grace, self._on_lost)
        self._disturbed = asyncio.Event()
        self._heard = asyncio.Event()
        self._nmt_changed = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._blocked = ""
        self._taking_in = False
        self.heard_at: float | None = None
        """Loop time of the last heartbeat or boot-up."""

    def start(self) -> None:
        """Begin looking for the node."""
        self._task = asyncio.get_running_loop().create_task(
            self._run(), name=f"node {self._node.node_id}: supervision"
        )
        self._task.add_done_callback(self._ended)

    async def close(self) -> None:
        """End the task."""
        self._stale.stop()
        self._lost.stop()
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task})

    # --- what happens to the node ---

    def heard(self, state: NmtState) -> None:
        """A heartbeat or boot-up came."""
        node = self._node
        now = asyncio.get_running_loop().time()
        self.heard_at = now
        self._heard.set()
        self._nmt_changed.set()
        if state is NmtState.BOOT_UP:
            self._on_boot_up()
        elif node.state in _SETTLED:
            self._stale.feed(now)
            self._lost.feed(now)
            if node.heartbeat_stale:
                node.heartbeat_stale = False
                node.publish()
            if node.state is NodeState.OPERATIONAL and state is not NmtState.OPERATIONAL:
                self._on_left_operational(state)

    def block(self, reason: str) -> None:
        """Something on the bus makes the node unusable until it is put right; it is tried again from time to
        time.
        """
        self._blocked = reason
        self._node.interrupt(self._node.is_away(reason), stop=True)
        self._node.enter(NodeState.REFUSED, reason)
        self._disturbed.set()

    def bus_went(self, reason: str) -> None:
        """The wire is gone: nothing can be commanded, and whether the motors stand is unknown."""
        node = self._node
        if node.state is not NodeState.ABSENT:
            self._lose(f"The bus can't carry commands: {reason}")

    def bus_came(self) -> None:
        """The wire is back: identify and arm everything anew."""
        self._disturbed.set()

    def _on_boot_up(self) -> None:
        node = self._node
        if node.state in (NodeState.ABSENT, NodeState.LOST) and not self._taking_in:
            node.forget()
            return  # it is just being looked for, and found by this
        if node.state in _SETTLED:
            error = node.is_away("it restarted by itself; references and unsaved parameters are lost.")
            node.interrupt(error, stop=False)
        node.sdo.fail_all(node.is_away("it has just restarted."))
        node.forget()
        self._unwatch()
        self._blocked = ""
        node.enter(NodeState.BOOTED, "It has booted; it is being identified.")
        self._disturbed.set()

    def _on_left_operational(self, state: NmtState) -> None:
        node = self._node
        node.interrupt(
            node.is_away(f"it left NMT Operational for {state.name}; somebody else commands it."), stop=True
        )
        for axis in node.axes:
            axis.lose()
        self._unwatch()
        node.enter(NodeState.BOOTED, f"It went to NMT {state.name} by itself; it is taken in anew.")
        self._disturbed.set()

    def _on_stale(self) -> None:
        node = self._node
        if node.state in _SETTLED and not node.heartbeat_stale:
            node.heartbeat_stale = True
            late = node.is_away(
                "its heartbeat is late; a stop was sent, but whether the axis stands is unknown."
            )
            for axis in node.axes:
                if axis.motion is not None or axis.status.moving:
                    axis.interrupt(late, stop=True)
            node.publish()

    def _on_lost(self) -> None:
        if self._node.state in _SETTLED:
            self._lose("Its heartbeat ended. Whether its motors turn is unknown.")

    def _lose(self, reason: str) -> None:
        node = self._node
        if node.state is not NodeState.LOST:
            node.counters.losses += 1
        error = node.is_away(reason)
        node.interrupt(error, stop=False)
        node.sdo.fail_all(error)
        for axis in node.axes:
            axis.lose()
        node.nmt_state = None
        self._unwatch()
        node.enter(NodeState.LOST, reason)
        self._disturbed.set()

    def _unwatch(self) -> None:
        self._stale.stop()
        self._lost.stop()
        self._node.heartbeat_stale = False

    # --- the task ---

    async def _run(self) -> None:
        while True:
            self._disturbed.clear()
            work = asyncio.create_task(self._take_in(), name=f"node {self._node.node_id}: taking in")
            disturbed = asyncio.create_task(
                self._disturbed.wait(), name=f"node {self._node.node_id}: watching"
            )
            try:
                await asyncio.wait({work, disturbed}, return_when=asyncio.FIRST_COMPLETED)
                if work.done():
                    await work  # a bug in it ends the supervision, loudly
                    retry = None if self._node.state is NodeState.OPERATIONAL else self._timing.refused_retry
                    await asyncio.wait({disturbed}, timeout=retry)
            finally:
                for task in (work, disturbed):
                    task.cancel()
                await asyncio.gather(work, disturbed, return_exceptions=True)

    async def _take_in(self) -> None:
        """Until the node is operational, or refused."""
        node = self._node
        pause = self._timing.probe_first
        while True:
            self._taking_in = False
            await self._find()
            self._taking_in = True
            try:
                await self._bring_up()
            except (WrongIdentity, ConfigurationRefused, BadValue, UnknownObject) as error:
                node.enter(NodeState.REFUSED, error.message)
                return
            except DuplicateNode as error:
                node.enter(NodeState.DUPLICATE, error.message)
                return
            except (SdoError, BusError, NodeAway) as error:
                # Also an abort in a place where the module should not give one: look again, more and more
                # rarely.
                node.enter(NodeState.LOST, f"It stopped answering while being taken in: {error.message}")
                self._heard.clear()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(pause):
                        await self._heard.wait()
                pause = min(2 * pause, self._timing.probe_last)
            else:
                return

    async def _find(self) -> None:
        """Probe until something answers; whatever is heard of the node ends a pause at once."""
        node = self._node
        pause = self._timing.probe_first
        while True:
            self._heard.clear()
            if node.nmt_state is NmtState.STOPPED:
                self._wake_from_stopped()
            if await self._answers():
                return
            self._wake_from_stopped()
            if await self._answers():
                return
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await self._heard.wait()
            pause = min(2 * pause, self._timing.probe_last)

    def _wake_from_stopped(self) -> None:
        """A node in NMT Stopped has no SDO. It is never reset for that: its axes may be turning."""
        with contextlib.suppress(BusError):
            self._node.command_nmt(NmtCommand.ENTER_PRE_OPERATIONAL)

    async def _answers(self) -> bool:
        try:
            await self._node.objects.read_as(DEVICE_TYPE, DataType.UNSIGNED32, priority=Priority.CONFIGURE)
        except SdoAborted:
            return True
        except CanaxisError:
            return False
        return True

    async def _bring_up(self) -> None:
        node = self._node
        config = node.backbone.config
        if self._blocked:
            reason, self._blocked = self._blocked, ""
            raise ConfigurationRefused(reason, node=node.node_id)
        node.enter(NodeState.BOOTED, "It answers; it is being identified.")
        node.particulars = None
        node.particulars = await identify(
            node.node_id, node.name, node.profile, node.objects, node.counters.sdo
        )
        node.enter(NodeState.IDENTIFIED, "It is being configured.")
        await configure.produce_heartbeat(node.objects, config)
        await self._change_nmt(NmtCommand.ENTER_PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL)
        node.note_armed(await configure.arm_failsafe(node.objects, config))
        for axis in node.axes:
            axis.seed(*await axis.setup.look())
            axis.adopted = not await axis.setup.configure()
        await configure.remap(node.node_id, node.objects, (pdo for axis in node.pdos.axes for pdo in axis))
        node.enter(NodeState.CONFIGURED, "It is being started.")
        await self._change_nmt(NmtCommand.START, NmtState.OPERATIONAL)
        await self._status_of_every_axis()
        node.enter(NodeState.OPERATIONAL)
        for axis in node.axes:
            axis.back_in_reach()

    async def _change_nmt(self, command: NmtCommand, state: NmtState) -> None:
        """Command and wait for a heartbeat that says so; the command is a level and may be repeated."""
        node = self._node
        each = self._heartbeat_period + self._timing.nmt_change / 2
        try:
            async with asyncio.timeout(2 * each):
                while True:
                    node.nmt_state = None  # only a heartbeat from now on counts
                    node.command_nmt(command)
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(each):
                            await self._follows(state)
                            return
        except TimeoutError:
            raise NodeAway(
                f"Node {node.name} did not go to NMT {state.name} within {2 * each:g} s.",
                hint="Check that no second master commands it; it is tried again later.",
                node=node.node_id,
            ) from None

    async def _follows(self, state: NmtState) -> None:
        """Wait for a heartbeat that says so."""
        while self._node.nmt_state is not state:
            self._nmt_changed.clear()
            await self._nmt_changed.wait()

    async def _status_of_every_axis(self) -> None:
        node = self._node
        patience = 5 * self._timing.pdo_event_timer
        for axis in node.axes:
            if not await axis.has_status(patience):
                raise NodeAway(
                    f"Node {node.name} was started, but the status of axis {axis.name} does not come.",
                    hint="Check that nothing else on the bus uses the same COB-IDs.",
                    node=node.node_id,
                    axis=axis.number,
                )

    def _ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled():
            error = task.exception()
            if error is not None:
                self._node.backbone.report_bug(error)
