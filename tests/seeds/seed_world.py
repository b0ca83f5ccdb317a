"""Master, modules and bus of one run, in one process on a virtual clock."""

from __future__ import annotations

import asyncio
import functools
import random
from collections import deque
from collections.abc import Callable, Collection, Sequence
from contextvars import Context

from seed_clients import MODEL
from seed_faults import Weather
from seed_invariants import Invariants
from seed_trace import Trace
from virtual_loop import VirtualLoop, service_context

from app.operations.operation import RegisteredOperation
from drivers.bus.base import BusCounters, BusState, FrameHandler, StateHandler
from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.cia301 import cob
from drivers.cia301.nmt import ALL_NODES, NmtCommand
from drivers.devices.catalog import Catalog
from drivers.master import Axis, AxisConfig, Network, NetworkConfig, NodeConfig
from drivers.sim.module import SimulatedModule
from drivers.sim.runner import SimulatedNode

MASTER_ID = 127
AXES = tuple(AxisConfig(name=name, homing_method=35) for name in ("x", "y", "z"))

catalog = functools.cache(Catalog.load)


class ServiceBus:
    """The service's side of its port: the wire's turns run outside of the service's context, and what the
    wire brings waits, like frames in a socket, until the service's event loop looks.
    """

    def __init__(self, port: MemoryBus, service: Context, wire: Context) -> None:
        self._port = port
        self._service = service
        self._wire = wire

    @property
    def name(self) -> str:
        return self._port.name

    @property
    def state(self) -> BusState:
        return self._port.state

    @property
    def counters(self) -> BusCounters:
        return self._port.counters

    @property
    def beside(self) -> None:
        """None: a trajectory's sender stays in the event loop, on its clock."""

    async def open(self) -> None:
        self._port.join()

    async def close(self) -> None:
        await self._port.close()

    def withdraw(self, cob_ids: Collection[int]) -> int:
        return self._port.withdraw(cob_ids)

    def send(self, frame: Frame, *, urgent: bool = False, answered: bool = True) -> None:
        self._wire.run(functools.partial(self._port.send, frame, urgent=urgent, answered=answered))

    def subscribe(self, on_frames: FrameHandler, on_state: StateHandler | None = None) -> Callable[[], None]:
        loop = asyncio.get_running_loop()
        subscribed = True

        def bring(handler: Callable[..., None], *arguments: object) -> None:
            if subscribed:
                handler(*arguments)

        def frames(batch: Sequence[Frame]) -> None:
            loop.call_soon(bring, on_frames, batch, context=self._service)

        def state(now: BusState, reason: str) -> None:
            if on_state is not None:
                loop.call_soon(bring, on_state, now, reason, context=self._service)

        end = self._port.subscribe(frames, state)

        def unsubscribe() -> None:
            nonlocal subscribed
            subscribed = False
            end()

        return unsubscribe


class World:
    """Everything of one run but its clients and its faults."""

    def __init__(self, rng: random.Random, weather: random.Random) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        self.loop = loop
        self.trace = Trace()
        self.service = service_context()
        self.wire = MemoryWire(bit_rate=1_000_000)
        self.weather = Weather(weather, self._crossing, functools.partial(self.trace.note, "weather"))
        self.wire.faults = self.weather
        self.wire.tap(self.trace.frame)
        self.port = self.wire.port("service")
        bus = ServiceBus(self.port, self.service, Context())
        node_ids = range(1, rng.choice((1, 1, 2, 3)) + 1)
        config = NetworkConfig(
            nodes=tuple(NodeConfig(node_id=n, name=f"m{n}", model=MODEL, axes=AXES) for n in node_ids),
            master_node_id=MASTER_ID,
        )
        self.network = Network(bus, config, catalog())
        self.operations: deque[RegisteredOperation] = deque(maxlen=20)
        self.modules: dict[int, SimulatedNode] = {}
        self.module_ports: dict[int, MemoryBus] = {}
        for node_id in node_ids:
            port = self.wire.port(f"module {node_id}")
            module = SimulatedModule(catalog().profile(MODEL), node_id, serial=node_id)
            self.module_ports[node_id] = port
            self.modules[node_id] = SimulatedNode(module, port)
        self.cob_ids = self._cob_ids()
        self.invariants = Invariants(self)
        self.loop.on_instant = self.invariants.look
        loop.set_exception_handler(self._unhandled)

    @property
    def axes(self) -> tuple[Axis, ...]:
        return tuple(axis for node in self.network.nodes.values() for axis in node.axes)

    async def open(self) -> None:
        for node in self.modules.values():
            await node.start()
        await self.loop.create_task(self.network.open(), name="open", context=self.service)

    async def close(self) -> None:
        await self.loop.create_task(self.network.close(), name="close", context=self.service)
        self.invariants.closed()
        for node in self.modules.values():
            await node.stop()

    def mend(self) -> None:
        """The faults are over."""
        self.trace.note("FAULT", "all faults end")
        self.weather.clear()
        for port in (self.port, *self.module_ports.values()):
            port.plug()
            port.recover()
            port.release()
        for node_id, node in self.modules.items():
            node.faults.clear()
            self.power_on(node_id)

    # --- hands on the modules

    def power_off(self, node_id: int) -> None:
        self.modules[node_id].power_off()
        self.invariants.restarted(node_id)

    def power_on(self, node_id: int) -> None:
        if not self.modules[node_id].module.powered:
            self.modules[node_id].power_on()
            self.invariants.restarted(node_id)

    def power_cycle(self, node_id: int) -> None:
        self.power_off(node_id)
        self.power_on(node_id)

    def stranger_commands(self, command: NmtCommand, node_id: int) -> None:
        if command is NmtCommand.RESET_NODE:
            for number in self.modules:
                if node_id in (ALL_NODES, number):
                    self.invariants.restarted(number)

    # --- inside

    def _crossing(self, frame: Frame) -> None:
        self.invariants.crossing(frame)

    def _unhandled(self, _: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        self.invariants.violated(
            f"unhandled in the event loop: {context.get('message')}: {context.get('exception')!r}"
        )

    def _cob_ids(self) -> list[int]:
        """Every identifier that means something on this bus."""
        found = {cob.NMT, cob.heartbeat(MASTER_ID)}
        for node_id, node in self.network.plan.nodes.items():
            found |= {
                cob.emcy(node_id),
                cob.sdo_request(node_id),
                cob.sdo_response(node_id),
                cob.heartbeat(node_id),
            }
            found |= {pdo.cob_id for axis in node.axes for pdo in axis if pdo.enabled}
        return sorted(found)
