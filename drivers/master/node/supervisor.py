"""What takes a node in and watches over it: absent, booted, identified, configured, operational; and back.

One task per node, so that no node's trouble delays another's. The router calls `heard` synchronously;
whatever that changes about the node is done at once, and the task then starts over from looking for the node.
"""

from __future__ import annotations

import asyncio
import contextlib

from drivers.cia301.nmt import NmtState
from drivers.errors import (
    BadValue,
    BusError,
    CanaxisError,
    ConfigurationRefused,
    NodeAway,
    SdoError,
    UnknownObject,
    WrongIdentity,
)
from drivers.master.node.body import NodeBody
from drivers.master.node.boot import boot_up
from drivers.master.node.identity import DuplicateNode
from drivers.master.node.search import find, is_alone
from drivers.master.seen.status import SETTLED, Adoption, NodeState
from drivers.master.seen.watch import Watchdog


class NodeSupervisor:
    """Brings one node up and notices when it goes."""

    def __init__(self, node: NodeBody) -> None:
        self._node = node
        backbone = node.backbone
        self._timing = backbone.timing
        period = backbone.config.node_heartbeat_ms / 1000
        grace = self._timing.loop_grace
        self._stale = Watchdog(period * self._timing.heartbeat_stale, grace, self._on_stale)
        self._lost = Watchdog(period * self._timing.heartbeat_lost, grace, self._on_lost)
        self._disturbed = asyncio.Event()
        self._heard = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._held = False
        """Whether something but the node itself keeps it from being taken in for now."""
        self._taking_in = False
        self._attempts: list[asyncio.Future[None]] = []
        self._restarted_at: float | None = None
        """Loop time of a boot-up out of the blue that was not yet looked into."""
        self._settled_at = 0.0

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
        self._tell(self._node.is_away("the network is being closed."))

    async def take_in_now(self) -> None:
        """Try once more, now, and return when the node is operational; raises what prevents it.

        An attempt that runs already is waited for.
        """
        attempt: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._attempts.append(attempt)
        if not self._taking_in:
            self._unwatch()
            self._held = False
            self._disturbed.set()
        await attempt

    # --- what happens to the node ---

    def heard(self, state: NmtState) -> None:
        """A heartbeat or boot-up came."""
        node = self._node
        now = asyncio.get_running_loop().time()
        node.heard_at = now
        self._heard.set()
        if state is NmtState.OPERATIONAL:
            node.operational_at = now
        if state is NmtState.BOOT_UP:
            self._on_boot_up(now)
        elif node.state in SETTLED:
            self._stale.feed(now)
            self._lost.feed(now)
            if node.heartbeat_stale:
                node.heartbeat_stale = False
                node.publish()
            if node.state is NodeState.OPERATIONAL and state is not NmtState.OPERATIONAL:
                if now - self._settled_at < self._timing.sdo_quarantine:
                    node.nmt_state = NmtState.OPERATIONAL  # it said so before it was started
                else:
                    self._on_left_operational(state)

    def block(self, reason: str) -> None:
        """Something on the bus makes the node unusable until it is put right; it is tried again from time to
        time.
        """
        error = self._node.is_away(reason)
        self._hold(error)
        self._node.interrupt(error, stop=True)
        self._node.enter(NodeState.REFUSED, reason)

    def duplicated(self, reason: str) -> None:
        """Two nodes have this ID: as `block`, and nothing is written to either."""
        error = DuplicateNode(f"Node {self._node.name}: {reason}", node=self._node.node_id)
        self._hold(error)
        self._node.sdo.fail_all(error)
        self._enter_duplicate(error)

    def _hold(self, error: CanaxisError) -> None:
        self._tell(error)
        self._held = True
        self._disturbed.set()

    def bus_went(self, reason: str) -> None:
        """The wire is gone: nothing can be commanded, and whether the motors stand is unknown."""
        node = self._node
        if node.state is not NodeState.ABSENT:
            self._lose(f"The bus can't carry commands: {reason}")

    def bus_came(self) -> None:
        """The wire is back: identify and arm everything anew."""
        self._disturbed.set()

    def _on_boot_up(self, now: float) -> None:
        node = self._node
        if node.state in (NodeState.ABSENT, NodeState.LOST) and not self._taking_in:
            node.forget()
            return  # it is just being looked for, and found by this
        if node.state in SETTLED:
            self._restarted_at = now
        elif self._restarted_at is not None:
            self._restarted_at = now  # again, while the first was looked into
        node.enter(NodeState.BOOTED, "It has booted; it is being identified.")
        # A node that restarted takes no PDO. But if another one came under its ID, this one still moves.
        node.interrupt(
            node.is_away("it restarted by itself; references and unsaved parameters are lost."), stop=True
        )
        node.sdo.fail_all(node.is_away("it has just restarted."))
        node.forget()
        self._unwatch()
        self._held = False
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
        if node.state in SETTLED and not node.heartbeat_stale:
            node.heartbeat_stale = True
            late = node.is_away(
                "its heartbeat is late; a stop was sent, but whether the axis stands is unknown."
            )
            for axis in node.axes:
                if axis.motion is not None or axis.status.moving:
                    axis.interrupt(late, stop=True)
                    axis.adopt(Adoption.of(axis.status, "It moved when its node's heartbeat became late."))
            node.publish()

    def _on_lost(self) -> None:
        if self._node.state in SETTLED:
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
        self._taking_in = False
        if self._held:
            self._held = False
            return  # until the next try, or until somebody asks for one
        if self._restarted_at is not None and not await self._is_alone(self._restarted_at):
            return
        pause = self._timing.probe_first
        while True:
            self._taking_in = False
            await find(self._node, self._heard, self._not_found)
            self._taking_in = True
            if await self._boot():
                return
            self._heard.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await self._heard.wait()
            pause = min(2 * pause, self._timing.probe_last)

    async def _boot(self) -> bool:
        """Whether that is settled, for better or worse; False: it is tried again soon."""
        node = self._node
        try:
            await boot_up(node)
        except (WrongIdentity, ConfigurationRefused, BadValue, UnknownObject) as error:
            node.enter(NodeState.REFUSED, error.message)
            self._tell(error)
        except DuplicateNode as error:
            self._enter_duplicate(error)
        except (SdoError, BusError, NodeAway) as error:
            # Also an abort in a place where the module should not give one: look again, more and more rarely.
            node.enter(NodeState.LOST, f"It stopped answering while being taken in: {error.message}")
            self._tell(error)
            return False
        else:
            self._settle()
        return True

    def _settle(self) -> None:
        """The node is operational. Its heartbeat is awaited from now on, whether one came already or not."""
        node = self._node
        self._settled_at = asyncio.get_running_loop().time()
        self._stale.feed(self._settled_at)
        self._lost.feed(self._settled_at)
        node.enter(NodeState.OPERATIONAL)
        for axis in node.axes:
            axis.back_in_reach()
        self._tell(None)

    async def _is_alone(self, restarted_at: float) -> bool:
        """After a boot-up out of the blue: whether the node did restart, or another one came under its ID."""
        node = self._node
        alone = await is_alone(node, restarted_at)
        self._restarted_at = None
        if not alone:
            self._enter_duplicate(
                DuplicateNode(
                    f"A node has booted with the ID {node.node_id} while {node.name} went on: two nodes have "
                    "it.",
                    node=node.node_id,
                )
            )
        return alone

    def _enter_duplicate(self, error: DuplicateNode) -> None:
        """Stop by PDO what may run, which both understand; nothing is written."""
        self._unwatch()
        self._node.enter(NodeState.DUPLICATE, error.message)
        self._node.interrupt(error, stop=True)
        self._tell(error)

    def _tell(self, error: CanaxisError | None) -> None:
        """An attempt to take the node in has ended: say so to who waits for it."""
        self._taking_in = False
        attempts, self._attempts = self._attempts, []
        for attempt in attempts:
            if not attempt.done():
                if error is None:
                    attempt.set_result(None)
                else:
                    attempt.set_exception(error)

    def _not_found(self) -> None:
        node = self._node
        if node.state is not NodeState.ABSENT and node.state is not NodeState.LOST:
            node.enter(NodeState.LOST, "It does not answer any more. Whether its motors turn is unknown.")
        self._tell(node.is_away(f"it does not answer ({node.state})."))

    def _ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled():
            error = task.exception()
            if error is not None:
                self._node.backbone.report_bug(error)
