"""Waiting until an input is on or off, or an analog one is above or below a value.

A general-purpose input is asked for by SDO, `POLL` seconds apart, at the lowest priority. All waits of a
network ask at the same moments, so that those for one object share one transfer: however many there are, they
cost a node at most one read of each of its inputs each time. A pulse shorter than that may be missed. A limit
or home switch comes by TPDO with the axis's status, and costs nothing.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.cia301.objects import Address
from drivers.errors import (
    BadValue,
    CanaxisError,
    InputTimeout,
    NotReady,
    Obstacle,
    SdoQueueFull,
    SdoQueueTimeout,
    SdoTimeout,
)
from drivers.master.motions.motion import MotionKind, Result, Undertaking
from drivers.master.node.io import DIGITAL_INPUTS
from drivers.master.seen.status import AxisStatus

if TYPE_CHECKING:
    from drivers.master.axis.axis import Axis
    from drivers.master.node.node import Node

POLL = 0.05
"""Seconds between two looks at an input that no TPDO brings."""
MOST = 64
"""Waits that may run on one node."""
LONGEST = 3600.0
"""Seconds that a wait may last."""

_PASSING = (SdoTimeout, SdoQueueTimeout, SdoQueueFull)
"""One look that failed: the next one may do. That the node is gone its supervisor tells."""


@dataclass(frozen=True, slots=True)
class Level:
    """An input that is to be on, or off."""

    name: str
    wanted: bool
    bit: int
    """Of 2702h."""

    async def reached(self, node: Node) -> Result:
        """Return once it is."""
        while True:
            value = await _look(node, DIGITAL_INPUTS)
            if value is not None and bool(value >> self.bit & 1) is self.wanted:
                return {"on": self.wanted}
            await _pause()


@dataclass(frozen=True, slots=True)
class Threshold:
    """An analog input that is to be above or below a value."""

    name: str
    number: int
    above: float | None = None
    """As the converter has it; not reached by the value itself."""
    below: float | None = None

    async def reached(self, node: Node) -> Result:
        """Return once it is."""
        address = node.terminals.analog[self.number].address
        while True:
            raw = await _look(node, address)
            if raw is not None and self._is_met(raw):
                volts = node.terminals.analog_level(self.number, raw).volts
                return {"raw": raw} if volts is None else {"raw": raw, "volts": volts}
            await _pause()

    def _is_met(self, raw: int) -> bool:
        return (self.above is not None and raw > self.above) or (self.below is not None and raw < self.below)


@dataclass(frozen=True, slots=True)
class SwitchLevel:
    """A limit or home switch of an axis that is to be pressed, or not."""

    name: str
    wanted: bool
    axis: Axis
    switch: str
    """A field of `Switches`."""

    async def reached(self, node: Node) -> Result:
        """Return once it is."""
        del node
        while not await self.axis.shows(self._is_met, LONGEST):
            pass
        return {"on": self.wanted}

    def _is_met(self, status: AxisStatus) -> bool:
        return not status.stale and bool(getattr(status.switches, self.switch)) is self.wanted


Condition = Level | Threshold | SwitchLevel


def digital(node: Node, ref: int | str, *, becomes: bool) -> Condition:
    """The condition for a digital input by number or name, or for a switch such as ``x.home``.

    Raises `BadValue` with the names that the node knows.
    """
    for number, row in enumerate(node.terminals.digital):
        if ref in (number, str(number), row.title, row.name):
            return Level(row.title, becomes, row.key)
    switches = tuple(switches_of(node))
    for axis, switch, name in switches:
        if ref in (name, f"{axis.number}.{switch}"):
            return SwitchLevel(name, becomes, axis, switch)
    known = [row.title for row in node.terminals.digital] + [name for _, _, name in switches]
    raise BadValue(
        f"Node {node.name} has no input {ref!r}.", hint=f"It has {', '.join(known)}.", node=node.node_id
    )


def analog(node: Node, number: int, *, above: float | None, below: float | None) -> Condition:
    """The condition for an analog input, in the converter's counts. Raises `BadValue`."""
    inputs = node.terminals.analog
    if not 0 <= number < len(inputs):
        raise BadValue(
            f"Node {node.name} has no analog input {number}.",
            hint=f"It has {len(inputs)}, counted from 0.",
            node=node.node_id,
        )
    low, high = inputs[number].minimum or 0, inputs[number].maximum or 0
    if not (above is None or above < high) or not (below is None or below > low):
        raise BadValue(
            f"Analog input {number} of node {node.name} is always within {low}..{high}: it never gets there.",
            hint="Give a value that the input can pass.",
            node=node.node_id,
        )
    return Threshold(f"AIN{number}", number, above, below)


def switches_of(node: Node) -> list[tuple[Axis, str, str]]:
    """The limit and home switches of each axis: whose, which, and its name."""
    return [
        (axis, switch, f"{axis.name}.{switch}")
        for axis in node.axes
        for switch in ("negative_limit", "positive_limit", "home")
    ]


class InputWait(Undertaking):
    """A wait for one input of a node. It holds no axis and moves nothing."""

    noun = "wait"

    def __init__(
        self,
        node: Node,
        condition: Condition,
        timeout_s: float,
        on_change: Callable[[Undertaking], None],
        undertaking_id: str | None = None,
    ) -> None:
        super().__init__(MotionKind.WAIT_INPUT, (), on_change, undertaking_id, node_id=node.node_id)
        self.condition = condition
        self.timeout_s = timeout_s

    async def cancel(self) -> None:
        """End it; nothing is stopped, since nothing moves for it."""
        self.give_up("It was cancelled on request.")


class Waits:
    """The waits that run on one node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._running: dict[Undertaking, asyncio.Task[None]] = {}

    def begin(
        self, condition: Condition, timeout_s: float, *, undertaking_id: str | None = None
    ) -> InputWait:
        """Begin to wait. Raises `NodeAway`, `BadValue`, and `NotReady` where too many wait already."""
        node = self._node
        if not 0 < timeout_s <= LONGEST:
            raise BadValue(f"timeout_s must be above 0 and at most {LONGEST:g}.", node=node.node_id)
        node.terminals.require_reach()
        if len(self._running) >= MOST:
            obstacle = Obstacle(
                "too_many_waits", f"{MOST} waits run on node {node.name} already.", "Cancel one, or wait."
            )
            raise NotReady(obstacle.message, obstacles=(obstacle,), node=node.node_id)
        wait = InputWait(node, condition, timeout_s, self._on_change, undertaking_id)
        self._on_change(wait)
        task = asyncio.create_task(self._carry_out(wait), name=f"node {node.node_id}: wait")
        self._running[wait] = task
        task.add_done_callback(lambda _: self._running.pop(wait, None))
        return wait

    def fail(self, error: CanaxisError) -> None:
        """The node is gone, or is not what it was: nothing is waited for any more."""
        for wait in tuple(self._running):
            wait.fail(error)

    async def close(self) -> None:
        """End every wait, and every task."""
        tasks = tuple(self._running.values())
        for wait in tuple(self._running):
            wait.give_up("The network is being closed.")
        if tasks:
            await asyncio.wait(tasks)

    async def _carry_out(self, wait: InputWait) -> None:
        loop = asyncio.get_running_loop()
        began = loop.time()
        wait.begin()
        try:
            async with asyncio.timeout(wait.timeout_s):
                result = await wait.condition.reached(self._node)
        except TimeoutError:
            wait.fail(self._late(wait))
        except CanaxisError as error:
            wait.fail(error)
        except asyncio.CancelledError:
            if not wait.done:
                raise
        except Exception as bug:
            wait.fail(CanaxisError(f"The service failed: {bug!r}.", node=self._node.node_id))
            self._node.backbone.report_bug(bug)
        else:
            wait.succeed({**result, "waited_s": round(loop.time() - began, 4)})

    def _late(self, wait: InputWait) -> InputTimeout:
        return InputTimeout(
            f"Input {wait.condition.name} of node {self._node.name} was not as it should be within "
            f"{wait.timeout_s:g} s.",
            hint="Look at the input (GET inputs), or give it more time.",
            node=self._node.node_id,
        )

    def _on_change(self, wait: Undertaking) -> None:
        self._node.backbone.events.publish("motion", node=self._node.node_id, data={"motion": wait})
        task = self._running.get(wait) if wait.done else None
        if task is not None and task is not asyncio.current_task():
            task.cancel()


async def _look(node: Node, address: Address) -> int | None:
    """The object's value; None if it did not come this time."""
    try:
        value = await node.read(address)
    except _PASSING:
        return None
    return value if isinstance(value, int) else None


async def _pause() -> None:
    """Until the next moment at which everybody looks."""
    now = asyncio.get_running_loop().time()
    left = (math.floor(now / POLL) + 1) * POLL - now
    await asyncio.sleep(left if left > POLL / 10 else left + POLL)
