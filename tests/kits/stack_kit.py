"""A master and simulated modules on one wire in one process, on whatever clock the test's loop has."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.cia301.objects import Address
from drivers.devices.catalog import Catalog
from drivers.master import (
    Axis,
    AxisConfig,
    Network,
    NetworkConfig,
    Node,
    NodeConfig,
    NodeState,
    Timing,
)
from drivers.master.motions.motion import Operation
from drivers.sim.module import SimulatedModule
from drivers.sim.runner import SimulatedNode

MODEL = "TMCM-3216"
AXES = tuple(AxisConfig(name=name, homing_method=35) for name in ("x", "y", "z"))


async def until(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    """Wait for something that no event tells, in small steps of the loop's (virtual) clock."""
    async with asyncio.timeout(seconds):
        while not condition():  # noqa: ASYNC110 - nothing tells, and the clock is virtual
            await asyncio.sleep(0.005)


def position_of(axis: Axis) -> int:
    """Where the axis is, steps; fails while that isn't known."""
    assert axis.status.position is not None
    return axis.status.position


def result_of(operation: Operation) -> dict[str, Any]:
    """What it came to; fails where there is nothing to tell."""
    assert operation.result is not None, operation.error
    return dict(operation.result)


class NeverAbove:
    """Sees, with every frame, that an object of module 1 never holds more than another one does."""

    def __init__(self, stack: Stack, lower: Address, upper: Address) -> None:
        self._dictionary = stack.modules[1].module.dictionary
        self._lower, self._upper = lower, upper
        self.seen: list[tuple[int, int]] = []
        """Each pair of values that they held, one after the other."""
        self._look()
        stack.wire.tap(lambda port, frame: self._look())

    def _look(self) -> None:
        held = self._dictionary.stored(self._lower), self._dictionary.stored(self._upper)
        if not self.seen or held != self.seen[-1]:
            self.seen.append(held)

    @property
    def kept(self) -> bool:
        """Whether it was so all the time."""
        return all(low <= high for low, high in self.seen)


@dataclass
class Stack:
    """The whole arrangement, with the hands that a test needs."""

    wire: MemoryWire
    port: MemoryBus
    network: Network
    modules: dict[int, SimulatedNode] = field(default_factory=dict)

    @property
    def node(self) -> Node:
        return self.network.node(1)

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.node.axes

    async def ready(self, *node_ids: int) -> None:
        wanted = node_ids or tuple(self.modules)
        await until(lambda: all(self.network.nodes[n].state is NodeState.OPERATIONAL for n in wanted))

    async def enabled(self) -> tuple[Axis, ...]:
        """Every axis of node 1, enabled."""
        await self.ready()
        await asyncio.gather(*(axis.enable() for axis in self.axes))
        return self.axes

    async def master_dies(self) -> None:
        """The master's process is gone in mid-sentence: nothing is stopped, nothing more is sent."""
        network = self.network
        last_words = self.wire.faults.drop(lambda frame: True)
        for node in network.nodes.values():
            await node.close()
        await asyncio.sleep(0.005)  # what the tasks said when they were ended is off the wire
        last_words.end()
        network._heartbeat.stop()
        assert network._unsubscribe is not None
        network._unsubscribe()
        network._unsubscribe = None

    def add_module(self, node_id: int) -> SimulatedNode:
        module = SimulatedModule(Catalog.load().profile(MODEL), node_id)
        node = SimulatedNode(module, self.wire.port(f"module {node_id}"))
        self.modules[node_id] = node
        return node


@asynccontextmanager
async def stack_of(
    *present: int,
    configured: tuple[int, ...] = (),
    axes: tuple[AxisConfig, ...] = AXES,
    timing: Timing | None = None,
    model: str = MODEL,
) -> AsyncIterator[Stack]:
    """A network of `configured` nodes (those present if empty) of which some are present; not waited for."""
    wire = MemoryWire(bit_rate=1_000_000)
    port = wire.port("master")
    config = NetworkConfig(
        nodes=tuple(
            NodeConfig(node_id=n, name=f"m{n}", model=model, axes=axes) for n in configured or present
        )
    )
    async with AsyncExitStack() as cleanup:
        stack = Stack(wire, port, Network(port, config, Catalog.load(), timing))
        for node_id in present:
            await cleanup.enter_async_context(stack.add_module(node_id))
        await cleanup.enter_async_context(stack.network)
        yield stack
