# Made by `make client` from canaxis/asynchronous/node.py: change that.
"""A module, by ID or name."""

from __future__ import annotations

from typing import Unpack

from canaxis.blocking.axis import Axis
from canaxis.blocking.carrier import Carrier
from canaxis.blocking.operation import Operation
from canaxis.contract.calls import NodeCalls
from canaxis.contract.options import AnalogOptions, WaitOptions
from canaxis.replies.axis import AxisStatus
from canaxis.replies.inputs_outputs import Inputs, Output
from canaxis.replies.node import Emergency, NodeStatus, ObjectValue


class Node:
    """A module, by ID or name."""

    def __init__(self, client: Carrier, node: int | str) -> None:
        self._client = client
        self._node = node
        self._calls = NodeCalls(node)

    def axis(self, axis: int | str) -> Axis:
        """The axis of that number or name; nothing is asked yet."""
        return Axis(self._client, self._node, axis)

    def status(self) -> NodeStatus:
        """What the module is, how far it is configured, and why it is not if it is not."""
        return self._client.run(self._calls.status())

    def axes(self) -> tuple[AxisStatus, ...]:
        """The status of each axis."""
        found = self._client.run(self._calls.axes())
        return found.axes

    def emergencies(self) -> tuple[Emergency, ...]:
        """The node's last emergencies with cause and remedy, the newest first."""
        found = self._client.run(self._calls.emergencies())
        return found.emergencies

    def boot(self) -> NodeStatus:
        """Take the node in anew, now. While it is operational its axes must be idle and disabled."""
        return self._client.run(self._calls.boot())

    def verify_failsafe(self) -> NodeStatus:
        """See whether the node stops its motors without the service; every enabled axis is in fault then."""
        return self._client.run(self._calls.verify_failsafe())

    def read_object(self, index: int, sub: int = 0) -> ObjectValue:
        """Ask the node for an object's value."""
        return self._client.run(self._calls.read(index, sub))

    def write_object(
        self, index: int, sub: int, value: float | str | bool, *, confirm: bool = False
    ) -> ObjectValue:
        """Write an object past the axis, and read it back. Off unless the service's settings allow it."""
        return self._client.run(self._calls.write(index, sub, value, confirm=confirm))

    def inputs(self) -> Inputs:
        """Digital and analog inputs, asked for now, and the switches of the axes."""
        return self._client.run(self._calls.inputs())

    def outputs(self) -> tuple[Output, ...]:
        """The digital outputs as the module holds them."""
        found = self._client.run(self._calls.outputs())
        return found.outputs

    def switch_output(self, output: int | str, *, on: bool) -> Output:
        """Switch an output, by number or name; the answer was read back."""
        return self._client.run(self._calls.switch_output(output, on=on))

    def wait_for_input(
        self, input_: int | str, *, becomes: bool = True, **options: Unpack[WaitOptions]
    ) -> Operation:
        """Wait for a digital input by number or name, or for a switch such as ``x.home``."""
        call = self._calls.wait_for_input(input_, becomes=becomes, options=options)
        return Operation(self._client, self._client.run(call))

    def wait_for_analog(self, analog: int, unit: str, **options: Unpack[AnalogOptions]) -> Operation:
        """Wait until an analog input is `above` or `below` a value in `unit`: `V` or `raw`."""
        call = self._calls.wait_for_analog(analog, unit, options)
        return Operation(self._client, self._client.run(call))
