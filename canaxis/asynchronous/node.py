"""A module, by ID or name."""

from __future__ import annotations

from typing import Unpack

from canaxis.asynchronous.axis import AsyncAxis
from canaxis.asynchronous.carrier import AsyncCarrier
from canaxis.asynchronous.operation import AsyncOperation
from canaxis.contract.calls import NodeCalls
from canaxis.contract.options import AnalogOptions, WaitOptions
from canaxis.replies.axis import AxisStatus
from canaxis.replies.inputs_outputs import Inputs, Output
from canaxis.replies.node import Emergency, NodeStatus, ObjectValue


class AsyncNode:
    """A module, by ID or name."""

    def __init__(self, client: AsyncCarrier, node: int | str) -> None:
        self._client = client
        self._node = node
        self._calls = NodeCalls(node)

    def axis(self, axis: int | str) -> AsyncAxis:
        """The axis of that number or name; nothing is asked yet."""
        return AsyncAxis(self._client, self._node, axis)

    async def status(self) -> NodeStatus:
        """What the module is, how far it is configured, and why it is not if it is not."""
        return await self._client.run(self._calls.status())

    async def axes(self) -> tuple[AxisStatus, ...]:
        """The status of each axis."""
        found = await self._client.run(self._calls.axes())
        return found.axes

    async def emergencies(self) -> tuple[Emergency, ...]:
        """The node's last emergencies with cause and remedy, the newest first."""
        found = await self._client.run(self._calls.emergencies())
        return found.emergencies

    async def boot(self) -> NodeStatus:
        """Take the node in anew, now. While it is operational its axes must be idle and disabled."""
        return await self._client.run(self._calls.boot())

    async def verify_failsafe(self) -> NodeStatus:
        """See whether the node stops its motors without the service; every enabled axis is in fault then."""
        return await self._client.run(self._calls.verify_failsafe())

    async def read_object(self, index: int, sub: int = 0) -> ObjectValue:
        """Ask the node for an object's value."""
        return await self._client.run(self._calls.read(index, sub))

    async def write_object(
        self, index: int, sub: int, value: float | str | bool, *, confirm: bool = False
    ) -> ObjectValue:
        """Write an object past the axis, and read it back. Off unless the service's settings allow it."""
        return await self._client.run(self._calls.write(index, sub, value, confirm=confirm))

    async def inputs(self) -> Inputs:
        """Digital and analog inputs, asked for now, and the switches of the axes."""
        return await self._client.run(self._calls.inputs())

    async def outputs(self) -> tuple[Output, ...]:
        """The digital outputs as the module holds them."""
        found = await self._client.run(self._calls.outputs())
        return found.outputs

    async def switch_output(self, output: int | str, *, on: bool) -> Output:
        """Switch an output, by number or name; the answer was read back."""
        return await self._client.run(self._calls.switch_output(output, on=on))

    async def wait_for_input(
        self, input_: int | str, *, becomes: bool = True, **options: Unpack[WaitOptions]
    ) -> AsyncOperation:
        """Wait for a digital input by number or name, or for a switch such as ``x.home``."""
        call = self._calls.wait_for_input(input_, becomes=becomes, options=options)
        return AsyncOperation(self._client, await self._client.run(call))

    async def wait_for_analog(
        self, analog: int, unit: str, **options: Unpack[AnalogOptions]
    ) -> AsyncOperation:
        """Wait until an analog input is `above` or `below` a value in `unit`: `V` or `raw`."""
        call = self._calls.wait_for_analog(analog, unit, options)
        return AsyncOperation(self._client, await self._client.run(call))
