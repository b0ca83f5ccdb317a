"""One bus with all its nodes: opening, closing, stop for everything, and what must never go unnoticed."""

from __future__ import annotations

import asyncio
import contextlib
import copy
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from types import TracebackType

from drivers.bus.base import Bus, BusState
from drivers.bus.frame import Frame
from drivers.cia301 import cob, heartbeat
from drivers.cia301.nmt import NmtState
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile
from drivers.errors import BadValue, BusError, CanaxisError, NodeAway, UnknownNode
from drivers.master.axis.axis import Axis
from drivers.master.ground.counters import NetworkCounters
from drivers.master.ground.router import Router
from drivers.master.ground.timing import Timing
from drivers.master.ground.where import AxisId
from drivers.master.link.backbone import Backbone
from drivers.master.node.commissioning import verify_failsafe
from drivers.master.node.node import Node
from drivers.master.plan.configuration import NetworkConfig
from drivers.master.plan.pdo_plan import PdoPlan
from drivers.master.plan.requests import MoveRequest
from drivers.master.seen.events import EventHub
from drivers.master.seen.status import BusStatus, Failsafe, NodeState
from drivers.master.seen.stops import AxisStop, StopLatch, StopOutcome, StopReport
from drivers.master.seen.watch import HeartbeatProducer
from drivers.master.together.coordinated_move import CoordinatedMove


class Network:
    """The master of one bus. Made and used in one event loop; `async with` opens and closes it."""

    def __init__(
        self, bus: Bus, config: NetworkConfig, catalog: Catalog, timing: Timing | None = None
    ) -> None:
        """Plan everything; nothing is sent yet. Raises `BadValue` for a configuration that can't work."""
        self.config = config
        self.timing = timing or Timing()
        self._backbone = Backbone(bus, config, self.timing, self._on_bug)
        profiles = {node.node_id: _profile(catalog, node.model) for node in config.nodes}
        for node in config.nodes:
            if len(node.axes) > profiles[node.node_id].axes:
                raise BadValue(f"Node {node.name!r}: a {node.model} has fewer axes than are configured.")
        self.plan = PdoPlan.make(profiles, config.master_node_id, self.timing)
        self.nodes: Mapping[int, Node] = {
            node.node_id: Node(node, profiles[node.node_id], self.plan.nodes[node.node_id], self._backbone)
            for node in config.nodes
        }
        self._router = Router(self._backbone.counters, self._on_bug)
        for node in self.nodes.values():
            node.route(self._router)
        for donor, node_id in self.plan.donors().items():
            self._router.add(cob.heartbeat(donor), self._donor_heard(donor, node_id))
        self._router.add(cob.heartbeat(config.master_node_id), self._on_own_heartbeat)
        self._router.add(cob.SYNC, self._backbone.sync.on_sync)
        self._heartbeat = HeartbeatProducer(config.heartbeat_ms / 1000, self._beat, self._on_missed)
        self._unsubscribe: Callable[[], None] | None = None
        self._closing = asyncio.Lock()
        self._bus_reason = ""
        self._bus_served = False
        self._warnings: dict[str, str] = {}
        self._groups: set[CoordinatedMove] = set()
        self._failed = asyncio.Event()
        self.failure: BaseException | None = None
        """The first unexpected error, a bug; after it the axes were told to stop and the service should end.
        """

    # --- opening and closing ---

    async def open(self) -> None:
        """Open the bus, start the heartbeat, look for the nodes. Raises `BusDown` if the bus can't be opened.

        Returns at once: nodes come up by themselves, each in its own time.
        """
        self._unsubscribe = self._backbone.bus.subscribe(self._router.dispatch, self._on_bus_state)
        try:
            await self._backbone.bus.open()
        except BaseException:
            self._unsubscribe()
            self._unsubscribe = None
            raise
        self._bus_served = self._backbone.bus.state.can_send
        self._heartbeat.start()
        for node in self.nodes.values():
            node.supervisor.start()

    async def close(self) -> None:
        """Refuse new work, ramp every axis down, disable it at standstill, then fall silent and close the
        bus.

        The heartbeat goes on until the axes stand, or `Timing.shutdown` is over. Idempotent.
        """
        self._backbone.closing = True
        async with self._closing:
            if self._unsubscribe is None:
                return
            try:
                async with asyncio.timeout(self.timing.shutdown):
                    await asyncio.gather(*(self._put_to_rest(axis) for axis in self._axes()))
                    await asyncio.gather(*(node.release() for node in self.nodes.values()))
            except TimeoutError:
                self._publish_bus(
                    "The network was closed though not every axis was seen to stand and be disabled."
                )
            finally:  # whatever goes wrong: a heartbeat that goes on would keep motors turning
                self._unsubscribe()
                self._unsubscribe = None
                self._heartbeat.stop()
                for group in tuple(self._groups):
                    await group.close()
                for node in self.nodes.values():
                    await node.close()
                await self._backbone.end_tasks()
                await self._backbone.bus.close()
                self.events.close()

    async def __aenter__(self) -> Network:
        await self.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    # --- what there is ---

    def node(self, ref: int | str) -> Node:
        """A node by ID or name. Raises `UnknownNode`."""
        for node in self.nodes.values():
            if ref in (node.node_id, str(node.node_id), node.name):
                return node
        raise UnknownNode(f"There is no node {ref!r}.")

    def axis(self, which: AxisId) -> Axis:
        """An axis by its numbers. Raises `UnknownNode`, `UnknownAxis`."""
        return self.node(which.node).axis(which.number)

    @property
    def events(self) -> EventHub:
        """What happens."""
        return self._backbone.events

    @property
    def counters(self) -> NetworkCounters:
        """What was counted so far; a copy."""
        return copy.copy(self._backbone.counters)

    @property
    def ready(self) -> bool:
        """Whether every configured node is operational."""
        return all(node.state is NodeState.OPERATIONAL for node in self.nodes.values())

    def bus_status(self) -> BusStatus:
        """A snapshot of the wire."""
        bus = self._backbone.bus
        return BusStatus(bus.name, bus.state, self._bus_reason, tuple(self._warnings.values()), self.counters)

    async def failed(self) -> BaseException:
        """Wait for an unexpected error: a bug, after which the service should end loudly."""
        await self._failed.wait()
        assert self.failure is not None
        return self.failure

    async def verify_failsafe(self, ref: int | str) -> Failsafe:
        """Pause our heartbeat at standstill and see whether the node stops its motors; see `commissioning`.

        Enabled axes of every node of the bus are in FAULT afterwards. Raises `UnknownNode`, `NotReady`,
        `TransitionTimeout`.
        """
        return await verify_failsafe(
            self.node(ref), self._axes(), self._pause_heartbeat, self._resume_heartbeat
        )

    # --- several axes ---

    def move_together(
        self,
        moves: Sequence[tuple[Axis, MoveRequest]],
        *,
        at_least: float = 0.0,
        replace: bool = False,
        operation_id: str | None = None,
    ) -> CoordinatedMove:
        """Have axes start on one SYNC and arrive together: `CoordinatedMove` says what is raised."""
        group = CoordinatedMove(moves, at_least=at_least, replace=replace, operation_id=operation_id)
        self._groups.add(group)
        group.watch(lambda _: self._groups.discard(group) if group.done else None)
        return group

    # --- stop for everything ---

    @property
    def stop_latched(self) -> StopLatch | None:
        """The stop for everything that was not yet reset."""
        return self._backbone.stop_latched

    def latch_stop(self, reason: str) -> StopLatch:
        """The part of `stop_all` that needs no waiting: latch, end every motion, send every halt."""
        latch = self._backbone.stop_latched
        if latch is None:
            latch = self._backbone.stop_latched = StopLatch(reason, datetime.now(UTC))
            self.events.publish("stop", data={"latched": True, "reason": reason})
        for axis in self._axes():
            try:
                axis.begin_stop(f"A stop for everything was given: {reason}")
            except Exception as bug:  # one axis's bug must not keep another from its halt
                self._note_failure(bug)
        return latch

    async def stop_all(self, reason: str) -> StopReport:
        """Stop every axis of every node and let none start until `reset_stop`.

        Latches and sends before the first await. Never raises for an axis: the report says what was found.
        """
        latch = self.latch_stop(reason)
        return StopReport(
            latch, tuple(await asyncio.gather(*(self._stop_one(axis) for axis in self._axes())))
        )

    def reset_stop(self) -> None:
        """Take the latch back. Nothing starts by it."""
        if self._backbone.stop_latched is not None:
            self._backbone.stop_latched = None
            self.events.publish("stop", data={"latched": False, "reason": ""})

    async def _stop_one(self, axis: Axis) -> AxisStop:
        def line(outcome: StopOutcome, message: str) -> AxisStop:
            return AxisStop(axis.node.node_id, axis.number, outcome, message)

        try:
            async with asyncio.timeout(self.timing.stop_all):
                await axis.stop("A stop for everything was given.")
        except (NodeAway, BusError) as error:
            return line(StopOutcome.UNREACHABLE, error.message)
        except CanaxisError as error:
            return line(StopOutcome.FAILED, error.message)
        except TimeoutError:
            return line(StopOutcome.FAILED, f"Axis {axis.name} was not seen to stand in time.")
        return line(StopOutcome.STOPPED, f"Axis {axis.name} stands.")

    async def _put_to_rest(self, axis: Axis) -> None:
        try:
            await axis.shut_down()
        except CanaxisError as error:
            self._publish_bus(f"While closing: {error.message}")
        except Exception as bug:  # one axis's bug must not keep another from its rest
            self._on_bug(bug)

    def _axes(self) -> tuple[Axis, ...]:
        return tuple(axis for node in self.nodes.values() for axis in node.axes)

    # --- what the wire tells ---

    def _on_bus_state(self, state: BusState, reason: str) -> None:
        self._bus_reason = "" if state is BusState.ACTIVE else reason
        self.events.publish("bus", data={"state": state, "reason": reason})
        if state.can_send is self._bus_served:
            return
        self._bus_served = state.can_send
        for node in self.nodes.values():
            if state.can_send:
                node.supervisor.bus_came()
            else:
                node.supervisor.bus_went(reason)

    def _donor_heard(self, donor: int, node_id: int) -> Callable[[Frame], None]:
        def heard(_: Frame) -> None:
            node = self.nodes[node_id]
            reason = (
                f"A node with ID {donor} is on the bus, but axes of {node.name} borrow its PDO identifiers. "
                f"Configure node {donor} too, or take it off the bus."
            )
            self._warn(f"donor {donor}", reason)
            if node.reason != reason and node.state not in (NodeState.ABSENT, NodeState.LOST):
                node.supervisor.block(reason)

        return heard

    def _on_own_heartbeat(self, _: Frame) -> None:
        self._warn(
            "master", f"Somebody else sends heartbeats as node {self.config.master_node_id}, our own ID."
        )

    def _warn(self, key: str, text: str) -> None:
        if self._warnings.get(key) != text:
            self._warnings[key] = text
            self._publish_bus(text)

    def _publish_bus(self, reason: str) -> None:
        self.events.publish("bus", data={"state": self._backbone.bus.state, "reason": reason})

    # --- our own life ---

    def _beat(self) -> None:
        frame = Frame(cob.heartbeat(self.config.master_node_id), heartbeat.encode(NmtState.OPERATIONAL))
        with contextlib.suppress(BusError):  # counted; the bus says by itself what is the matter
            self._backbone.send(frame, True, answered=False)

    def _pause_heartbeat(self) -> None:
        self._backbone.heartbeat_paused = True
        self._heartbeat.stop()

    def _resume_heartbeat(self) -> None:
        self._heartbeat.start()
        self._backbone.heartbeat_paused = False

    def _on_missed(self, periods: int) -> None:
        self._backbone.counters.late_heartbeats += periods

    def _on_bug(self, bug: BaseException) -> None:
        """Keep the first, and have every axis stop before anybody ends the service."""
        if self._note_failure(bug):
            self.latch_stop(f"The service failed unexpectedly: {bug!r}")

    def _note_failure(self, bug: BaseException) -> bool:
        """Whether it is the first."""
        if self.failure is not None:
            return False
        self.failure = bug
        self._failed.set()
        return True


def _profile(catalog: Catalog, model: str) -> DeviceProfile:
    try:
        return catalog.profile(model)
    except KeyError:
        raise BadValue(
            f"There is no profile of a {model!r}.", hint="Correct the node's model in the configuration."
        ) from None
