"""Several clients at once, who do whatever they like, as their share of the seed has it."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from seed_invariants import HIGHEST_SPEED
from seed_joint import Together, follow, move_together, some_axes

from app.operations.operation import RegisteredOperation
from drivers.cia301.objects import Address
from drivers.cia402 import objects
from drivers.errors import CanaxisError
from drivers.master import Axis, HomeRequest, Motion, MoveRequest, StopOutcome, VelocityRequest
from drivers.master.motions.motion import Operation
from drivers.master.node.node import Node
from drivers.master.plan.requests import OnBusy, SetPositionRequest

MODEL = "TMCM-3216"

if TYPE_CHECKING:
    from seed_world import World

PATIENCE = 60.0
"""Seconds in which every command but a motion answers, whatever happens."""
ENDS: tuple[dict[str, Any], ...] = ({}, {}, {"duration_s": 0.7}, {"travel": 4_321}, {"held": True})
"""Ways in which a velocity may end by itself; two of five have none."""
_READS = (objects.STATUSWORD, objects.POSITION, objects.PROFILE_VELOCITY, 0x1008, 0x1018)


class Client:
    """One of them. Errors of the master are what a client must live with; hanging is not."""

    def __init__(self, world: World, name: str, rng: random.Random) -> None:
        self._world = world
        self._name = name
        self._rng = rng
        self._motions: list[Operation] = []

    async def live(self, seconds: float) -> None:
        """Command this and that until the time is over."""
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds
        while loop.time() < end:
            await asyncio.sleep(self._rng.choice((0.0, 0.001, 0.02, 0.1, 0.3, 0.9)))
            name = self._rng.choice(_COMMANDS)
            axis = self._rng.choice(self._world.axes)
            await self._give(name, axis)

    async def _give(self, name: str, axis: Axis) -> None:
        command: Callable[[Axis], Awaitable[None]] = getattr(self, f"_{name}")
        task = asyncio.create_task(self._told(name, axis, command(axis)), name=f"{self._name}: {name}")
        patience = self._rng.choice((0.0, 0.003, 0.2)) if self._rng.random() < 0.15 else PATIENCE
        done, _ = await asyncio.wait({task}, timeout=patience)
        if not done:
            if patience == PATIENCE and not self._world.loop.stalled_in_all > 5:
                self._world.invariants.violated(f"{name} of {axis.node.node_id}.{axis.number} hangs")
            self._note(f"{name} of {axis.node.node_id}.{axis.number}: the client goes away")
            task.cancel()
            await asyncio.wait({task})

    async def _told(self, name: str, axis: Axis, work: Awaitable[None]) -> None:
        what = f"{name} of {axis.node.node_id}.{axis.number}"
        self._note(what)
        try:
            await work
        except CanaxisError as error:
            self._note(f"{what}: {type(error).__name__}: {error.message[:90]}")
        except Exception as bug:
            self._world.invariants.violated(f"{what} raised {bug!r}")
        else:
            self._note(f"{what}: done")

    # --- motions

    async def _move(self, axis: Axis) -> None:
        distances = (-30_000, -700, -1, 0, 1, 40, 9_000, 25_000)
        acceleration = self._rng.choice((None, None, 60_000, 400_000))
        request = MoveRequest(
            self._rng.choice(distances),
            relative=self._rng.random() < 0.5,
            velocity=self._rng.choice((None, 8_000, HIGHEST_SPEED)),
            acceleration=acceleration,
        )
        on_busy = self._on_busy()
        await self._follow(axis, axis.move_to(request, on_busy=on_busy))

    async def _velocity(self, axis: Axis) -> None:
        velocity = self._rng.choice((-HIGHEST_SPEED, -300, 0, 5_000, HIGHEST_SPEED))
        acceleration = self._rng.choice((None, 90_000))
        end = self._rng.choice(ENDS)
        request = VelocityRequest(velocity, acceleration, **(end if velocity else {}))
        await self._follow(axis, axis.run_at(request, on_busy=self._on_busy()))

    async def _home(self, axis: Axis) -> None:
        request = HomeRequest(method=self._rng.choice((35, 35, 17, 19)), fast=HIGHEST_SPEED, timeout_s=8.0)
        await self._follow(axis, axis.home(request, on_busy=self._on_busy()))

    async def _set_position(self, axis: Axis) -> None:
        request = SetPositionRequest(self._rng.choice((-5_000, 0, 12_345)), shift_limits=True)
        await self._follow(axis, axis.set_position(request))

    async def _move_together(self, axis: Axis) -> None:
        axes = await self._chosen(axis)
        name = self._joint_name()
        await self._follow_all(move_together(self._world.network, self._rng, axes, HIGHEST_SPEED, name))

    async def _trajectory(self, axis: Axis) -> None:
        axes = await self._chosen(axis)
        await self._follow_all(follow(self._rng, axes, self._joint_name()))

    async def _chosen(self, axis: Axis) -> list[Axis]:
        """Mostly enabled first, or it would seldom be that all of them are."""
        axes = some_axes(self._rng, self._world.axes, axis)
        if self._rng.random() < 0.7:
            await asyncio.gather(*(self._enable(one) for one in axes), return_exceptions=True)
        return axes

    def _joint_name(self) -> str:
        """Drawn, where it is random otherwise: it is in messages, and so in the trace."""
        return f"{self._rng.getrandbits(64):016x}"

    def _on_busy(self) -> OnBusy:
        return self._rng.choice((OnBusy.REJECT, OnBusy.REJECT, OnBusy.REPLACE, OnBusy.QUEUE, OnBusy.QUEUE))

    async def _follow(self, axis: Axis, motion: Motion) -> None:
        self._world.invariants.commanded(axis, motion)
        await self._await(motion)

    async def _follow_all(self, together: Together) -> None:
        self._world.invariants.commanded_together(together)
        await self._await(together.operation)

    async def _await(self, motion: Operation) -> None:
        self._world.operations.append(RegisteredOperation(motion, self._axes(motion), {}))
        self._motions.append(motion)
        await motion.wait(self._rng.choice((0.0, 0.005, 0.3, 3.0, 20.0)))

    async def _cancel_motion(self, axis: Axis) -> None:
        if self._motions:
            motion = self._rng.choice(self._motions[-3:])
            books = self._world.invariants.books
            axes = self._axes(motion)
            ended, commands = motion.done, {axis: books[axis].commands for axis in axes}
            waits = isinstance(motion, Motion) and motion in axes[0].queued and not axes[0].making_way
            await motion.cancel()
            if not ended and not waits:
                for one in axes:
                    self._world.invariants.acknowledged(one, "a cancellation", commands[one])

    def _axes(self, motion: Operation) -> list[Axis]:
        return [self._world.network.axis(each) for each in motion.axes]

    # --- power and stops

    async def _enable(self, axis: Axis) -> None:
        book = self._world.invariants.books[axis]
        if not axis.readiness("enable"):
            book.may_enable = True
            book.enables += 1
        await axis.enable()

    async def _enable_all(self, axis: Axis) -> None:
        await asyncio.gather(
            *(self._enable(one) for one in self._world.network.nodes[axis.id.node].axes),
            return_exceptions=True,
        )

    async def _disable(self, axis: Axis) -> None:
        book = self._world.invariants.books[axis]
        commands, enables = book.commands, book.enables
        await axis.disable()
        self._world.invariants.acknowledged(axis, "a disable", commands, disabled=True, enables=enables)

    async def _reset_fault(self, axis: Axis) -> None:
        await axis.reset_fault()

    async def _stop(self, axis: Axis) -> None:
        commands = self._world.invariants.books[axis].commands
        await axis.stop()
        self._world.invariants.acknowledged(axis, "a stop", commands)

    async def _quick_stop(self, axis: Axis) -> None:
        book = self._world.invariants.books[axis]
        commands, enables = book.commands, book.enables
        await axis.quick_stop()
        self._world.invariants.acknowledged(axis, "a quick stop", commands, disabled=True, enables=enables)

    async def _stop_all(self, axis: Axis) -> None:
        network, books = self._world.network, self._world.invariants.books
        commands = {one: book.commands for one, book in books.items()}
        report = await network.stop_all(self._name)
        if len(report.axes) != len(books):
            self._world.invariants.violated("a stop for everything forgot an axis")
        for line in report.axes:
            one = network.nodes[line.node].axes[line.axis]
            if line.outcome is StopOutcome.STOPPED:
                self._world.invariants.acknowledged(one, "a stop for everything", commands[one])
        await asyncio.sleep(self._rng.choice((0.0, 0.1, 0.5)))
        network.reset_stop()

    # --- objects

    async def _read(self, axis: Axis) -> None:
        address = self._address(axis, self._rng.choice(_READS))
        value = await axis.node.read(address)
        node_id = axis.node.node_id
        if isinstance(value, int) and not self._world.invariants.said(node_id, address, value):
            self._world.invariants.violated(
                f"a read of {address} of node {node_id} gave {value}, which it never said"
            )
        if isinstance(value, str) and value != MODEL:
            self._world.invariants.violated(f"a read of {address} of node {node_id} gave {value!r}")

    async def _write(self, axis: Axis) -> None:
        value = self._rng.choice((20_000, 51_200))
        node = axis.node
        assert isinstance(node, Node)
        await node.write(self._address(axis, objects.PROFILE_VELOCITY), value)

    async def _look(self, axis: Axis) -> None:
        """At the operations, as the service shows them."""
        for operation in tuple(self._world.operations)[-5:]:
            reply = operation.reply()
            if (reply.ended is not None) is not operation.motion.done:
                self._world.invariants.violated(
                    f"operation {reply.kind} is {reply.state}, ended {reply.ended}"
                )

    def _address(self, axis: Axis, index: int) -> Address:
        return Address(index + 0x800 * axis.number if index >= 0x6000 else index, 1 if index == 0x1018 else 0)

    def _note(self, text: str) -> None:
        self._world.trace.note(self._name, text)


_COMMANDS = (
    "move", "move", "move", "move", "velocity", "velocity", "home", "cancel_motion",
    "move_together", "move_together", "move_together", "trajectory", "trajectory", "set_position",
    "enable", "enable", "enable_all", "enable_all", "disable", "reset_fault", "reset_fault",
    "stop", "stop", "quick_stop", "stop_all", "write", "look",
    "read", "read", "read", "read", "read", "read",
)  # fmt: skip
