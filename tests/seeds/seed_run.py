"""One run: a world, its clients and its storm, the calm after it, and what came of it."""

from __future__ import annotations

import asyncio
import random
import traceback
from dataclasses import dataclass

from seed_clients import Client
from seed_faults import Storm
from seed_world import World
from virtual_loop import VirtualLoop

from drivers.errors import CanaxisError
from drivers.master import Axis, MotionState, MoveRequest, Network, NodeState

SETTLING = 2.0
"""Seconds after the storm in which what it did shows: a heartbeat that is missed, a frame that is late."""


def recovery(network: Network) -> float:
    """Seconds in which the service is operational again when the faults have ended, by `Timing`.

    At worst a node was just refused for what a fault made of it, then does not answer the first probe after
    the longest pause, and follows each of two NMT commands at the second try.
    """
    timing, period = network.timing, network.config.node_heartbeat_ms / 1000
    lost = timing.heartbeat_lost * period + timing.loop_grace
    found = timing.refused_retry + timing.probe_last + 2 * (timing.sdo_response + timing.sdo_quarantine)
    started = 4 * (period + timing.nmt_change / 2)
    return lost + found + started + CONFIGURING


CONFIGURING = 5.0
"""Seconds that all SDO transfers of taking in a node of three axes take, on a bus that others use too."""


@dataclass(frozen=True)
class Outcome:
    """What a run came to."""

    seed: int
    violation: str | None
    """The first broken invariant, and the trace up to it; None: all held."""
    digest: str
    """Of the trace."""
    lines: int
    seconds: float
    """Virtual."""

    def __str__(self) -> str:
        return f"seed {self.seed}: {self.violation}\n\nReplay it alone with: make soak SEED={self.seed}"


def run(seed: int) -> Outcome:
    """Play a seed to its end, or to its first violation."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(_play(seed))


async def _play(seed: int) -> Outcome:
    rng = {name: random.Random(f"{seed} {name}") for name in ("world", "weather", "storm", "clients")}
    world = World(rng["world"], rng["weather"])
    story = asyncio.create_task(_story(world, rng), name="story")
    found = asyncio.create_task(world.invariants.found.wait(), name="found")
    await asyncio.wait({story, found}, return_when=asyncio.FIRST_COMPLETED)
    for task in (story, found):
        task.cancel()
    await asyncio.gather(story, found, return_exceptions=True)
    if not story.cancelled() and (error := story.exception()) is not None:
        world.invariants.violated("the run itself failed: " + "".join(traceback.format_exception(error)))
    if world.invariants.violation is None:
        _nothing_is_left(world)
    else:
        await _abandon()
    return Outcome(seed, world.invariants.violation, world.trace.digest, world.trace.count, world.loop.time())


async def _story(world: World, rng: dict[str, random.Random]) -> None:
    storm_rng, clients_rng = rng["storm"], rng["clients"]
    await world.open()
    await _ready(world)
    seconds = storm_rng.choice((4.0, 8.0, 15.0))
    clients = [
        Client(world, f"client {n}", random.Random(clients_rng.random()))
        for n in range(clients_rng.choice((1, 2, 4)))
    ]
    tasks = [
        world.loop.create_task(client.live(seconds), context=world.service.copy(), name=f"client {n}")
        for n, client in enumerate(clients)
    ]
    try:
        await Storm(world, storm_rng, seconds).play()
        await asyncio.sleep(SETTLING)
        await _ready(world)
        await asyncio.gather(*tasks)
        await _all_is_well(world)
        await world.close()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _ready(world: World) -> None:
    """Every node is operational and every status fresh, within the stated time."""

    def ready() -> bool:
        nodes = world.network.nodes.values()
        return all(
            node.state is NodeState.OPERATIONAL and not node.heartbeat_stale for node in nodes
        ) and not any(axis.status.stale for axis in world.axes)

    bound = recovery(world.network)
    end = world.loop.time() + bound
    while not ready():
        await asyncio.sleep(0.05)
        if world.loop.time() > end:
            reasons = [f"{node.name} is {node.state}: {node.reason}" for node in world.network.nodes.values()]
            world.invariants.violated(f"not operational {bound} s after the faults ended: {reasons}")
            await asyncio.Event().wait()


async def _all_is_well(world: World) -> None:
    """Everything can be done again, at the first try."""
    world.network.reset_stop()
    tasks = [
        world.loop.create_task(_proven(world, axis), context=world.service.copy(), name="proof")
        for axis in world.axes
    ]
    await asyncio.gather(*tasks)


async def _proven(world: World, axis: Axis) -> None:
    book = world.invariants.books[axis]
    try:
        commands = book.commands
        await axis.stop()
        world.invariants.acknowledged(axis, "a stop", commands)
        await axis.reset_fault()
        book.may_enable = True
        book.enables += 1
        await axis.enable()
        motion = axis.move_to(MoveRequest(1_000 * (axis.number + 1)))
        world.invariants.commanded(axis, motion)
        await motion.wait(60)
        if motion.state is not MotionState.SUCCEEDED:
            world.invariants.violated(
                f"{book.name}: a move after all faults ended as {motion.state}: {motion.error}"
            )
    except CanaxisError as error:
        world.invariants.violated(f"{book.name} can't be used after all faults: {error!r}")


def _nothing_is_left(world: World) -> None:
    left = [task.get_name() for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    if left:
        world.invariants.violated(f"tasks left behind: {left}")


async def _abandon() -> None:
    """A run that failed is not closed in order: end whatever still runs."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    loop.on_instant = lambda: None
    for _ in range(5):
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
