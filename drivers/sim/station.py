"""`Station`: simulated modules on one wire, with a fault panel each, and a socketcand server if wanted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AsyncExitStack
from types import MappingProxyType, TracebackType
from typing import Final, NamedTuple, Self

from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile
from drivers.errors import BadValue, UnknownNode
from drivers.sim.module import SimulatedModule
from drivers.sim.motion.travel import AxisSettings
from drivers.sim.panel import ModulePanel
from drivers.sim.runner import SimulatedNode
from drivers.sim.socketcand import SocketcandServer
from drivers.sim.storage import Store

MODEL: Final = "TMCM-3216"
BIT_RATE: Final = 1_000_000
"""Of the wire where none is given, bit/s: the module's own default."""
LEAD: Final = 0.001
"""Of that wire, seconds: about what the timers of an event loop are late by. See `MemoryWire`."""


class Listen(NamedTuple):
    """Where the socketcand server listens; port 0 takes a free one."""

    host: str = "127.0.0.1"
    port: int = 0


class _Member(NamedTuple):
    node: SimulatedNode
    port: MemoryBus
    panel: ModulePanel


class Station:
    """Modules that run while the station is entered (``async with``), on the clock of the loop that entered.

    A module is known by the node ID that it was made with; its serial number is the same. Everything but the
    constructor must be called in the loop's thread.
    """

    def __init__(
        self,
        node_ids: Iterable[int] = (1,),
        profile: DeviceProfile | None = None,
        *,
        wire: MemoryWire | None = None,
        axes: Sequence[AxisSettings] | None = None,
        store: Callable[[int], Store] | None = None,
        listen: Listen | None = None,
    ) -> None:
        """Make a station of modules of one `profile` (a TMCM-3216 if left out).

        `axes` are the settings of each module's first axes; `store` gives the memory of a node ID, one that
        lasts as long as the module if left out. Without `listen` no other program can join. Raises `BadValue`
        for a node ID that is none or comes twice.
        """
        self.wire = wire if wire is not None else MemoryWire(bit_rate=BIT_RATE, lead=LEAD)
        self._profile = profile if profile is not None else Catalog.load().profile(MODEL)
        self._node_ids = tuple(_checked(node_ids))
        self._axes = axes
        self._store = store
        self._listen = listen
        self._server: SocketcandServer | None = None
        self._members: dict[int, _Member] = {}

    # --- what there is --------------------------------------------------------------------------------------

    @property
    def nodes(self) -> Mapping[int, SimulatedNode]:
        """The modules that run, by node ID."""
        return MappingProxyType({number: member.node for number, member in self._members.items()})

    @property
    def panels(self) -> Mapping[int, ModulePanel]:
        """Their fault panels, by node ID."""
        return MappingProxyType({number: member.panel for number, member in self._members.items()})

    def node(self, node_id: int) -> SimulatedNode:
        """A module that runs. Raises `UnknownNode`."""
        return self._member(node_id).node

    def panel(self, node_id: int) -> ModulePanel:
        """The hands on a module. Raises `UnknownNode`."""
        return self._member(node_id).panel

    @property
    def server(self) -> SocketcandServer | None:
        """The socketcand server; None without `listen`, or while the station isn't entered."""
        return self._server

    # --- coming and going -----------------------------------------------------------------------------------

    async def __aenter__(self) -> Self:
        """Listen, and power the modules on. Raises `BusError` if the address can't be had."""
        async with AsyncExitStack() as undo:
            undo.push_async_callback(self._close)
            if self._listen is not None:
                server = SocketcandServer(self.wire, host=self._listen.host, port=self._listen.port)
                await server.start()
                self._server = server
            for node_id in self._node_ids:
                await self.add(node_id)
            undo.pop_all()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self._close()

    async def add(self, node_id: int) -> ModulePanel:
        """Put one more module on the wire, powered. Raises `BadValue` for an ID that is none or taken."""
        tuple(_checked((*self._members, node_id)))
        store = None if self._store is None else self._store(node_id)
        module = SimulatedModule(self._profile, node_id, axes=self._axes, store=store, serial=node_id)
        port = self.wire.port(f"node {node_id}")
        node = SimulatedNode(module, port)
        panel = ModulePanel(node_id, node, port, self.wire.faults)
        await node.start()
        self._members[node_id] = _Member(node, port, panel)
        return panel

    async def remove(self, node_id: int) -> None:
        """Take a module off the wire for good. Raises `UnknownNode`."""
        member = self._member(node_id)
        del self._members[node_id]
        member.panel.end_wire_faults()
        await member.node.stop()
        self.wire.discard(member.port)

    async def _close(self) -> None:
        server, self._server = self._server, None
        try:
            for node_id in tuple(self._members):
                await self.remove(node_id)
        finally:
            if server is not None:
                await server.close()

    def _member(self, node_id: int) -> _Member:
        member = self._members.get(node_id)
        if member is None:
            known = ", ".join(map(str, self._members)) or "none"
            raise UnknownNode(
                f"no module with node ID {node_id} is simulated",
                hint=f"Simulated are: {known}.",
                node=node_id,
            )
        return member


def _checked(node_ids: Iterable[int]) -> Iterable[int]:
    seen: set[int] = set()
    for node_id in node_ids:
        if not 1 <= node_id <= 127:
            raise BadValue(f"a node ID is 1 to 127, not {node_id}")
        if node_id in seen:
            raise BadValue(f"node ID {node_id} is there already", hint="Give each module another one.")
        seen.add(node_id)
        yield node_id
