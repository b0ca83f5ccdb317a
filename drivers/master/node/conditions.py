"""What can be waited for at a node: an input that is on or off, an analog one above or below a value.

A general-purpose input is asked for by SDO, `POLL` seconds apart, at the lowest priority. All waits of a
network ask at the same moments, so that those for one object share one transfer: however many there are, they
cost a node at most one read of each of its inputs each time. A pulse shorter than that may be missed. A limit
or home switch comes by TPDO with the axis's status, and costs nothing.
"""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass

from drivers.cia301.objects import Address
from drivers.errors import BadValue, SdoQueueFull, SdoQueueTimeout, SdoTimeout
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import Result
from drivers.master.node.body import NodeBody
from drivers.master.node.io import DIGITAL_INPUTS
from drivers.master.node.waiting import LONGEST, Condition
from drivers.master.seen.status import AxisStatus

POLL = 0.05
"""Seconds between two looks at an input that no TPDO brings."""

_PASSING = (SdoTimeout, SdoQueueTimeout, SdoQueueFull)
"""One look that failed: the next one may do. That the node is gone its supervisor tells."""


@dataclass(frozen=True, slots=True)
class Level:
    """An input that is to be on, or off."""

    name: str
    node: NodeBody
    wanted: bool
    bit: int
    """Of 2702h."""

    async def reached(self) -> Result:
        """Return once it is."""
        while True:
            value = await _look(self.node, DIGITAL_INPUTS)
            if value is not None and bool(value >> self.bit & 1) is self.wanted:
                return {"on": self.wanted}
            await _pause()


@dataclass(frozen=True, slots=True)
class Threshold:
    """An analog input that is to be above or below a value."""

    name: str
    node: NodeBody
    number: int
    above: float | None = None
    """As the converter has it; not reached by the value itself."""
    below: float | None = None

    async def reached(self) -> Result:
        """Return once it is."""
        address = self.node.terminals.analog[self.number].address
        while True:
            raw = await _look(self.node, address)
            if raw is not None and self._is_met(raw):
                volts = self.node.terminals.analog_level(self.number, raw).volts
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

    async def reached(self) -> Result:
        """Return once it is."""
        while not await self.axis.shows(self._is_met, LONGEST):
            pass
        return {"on": self.wanted}

    def _is_met(self, status: AxisStatus) -> bool:
        return not status.stale and bool(getattr(status.switches, self.switch)) is self.wanted


def digital(node: NodeBody, ref: int | str, *, becomes: bool) -> Condition:
    """The condition for a digital input by number or name, or for a switch such as ``x.home``.

    Raises `BadValue` with the names that the node knows.
    """
    for number, row in enumerate(node.terminals.digital):
        if ref in (number, str(number), row.title, row.name):
            return Level(row.title, node, becomes, row.key)
    switches = tuple(switches_of(node))
    for axis, switch, name in switches:
        if ref in (name, f"{axis.number}.{switch}"):
            return SwitchLevel(name, becomes, axis, switch)
    known = [row.title for row in node.terminals.digital] + [name for _, _, name in switches]
    raise BadValue(
        f"Node {node.name} has no input {ref!r}.", hint=f"It has {', '.join(known)}.", node=node.node_id
    )


def analog(node: NodeBody, number: int, *, above: float | None, below: float | None) -> Condition:
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
    return Threshold(f"AIN{number}", node, number, above, below)


def switches_of(node: NodeBody) -> list[tuple[Axis, str, str]]:
    """The limit and home switches of each axis: whose, which, and its name."""
    return [
        (axis, switch, f"{axis.name}.{switch}")
        for axis in node.axes
        for switch in ("negative_limit", "positive_limit", "home")
    ]


async def _look(node: NodeBody, address: Address) -> int | None:
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
