"""Waiting until something holds at a node, such as an input that is on: see `conditions`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from drivers.errors import BadValue, CanaxisError, InputTimeout, NotReady
from drivers.master.link.node_link import NodeLink
from drivers.master.motions.motion import MotionKind, Operation, Result
from drivers.obstacles import TOO_MANY_WAITS

MOST = 64
"""Waits that may run on one node."""
LONGEST = 3600.0
"""Seconds that a wait may last."""


class Condition(Protocol):
    """What is waited for."""

    @property
    def name(self) -> str:
        """Of the input."""
        ...

    async def reached(self) -> Result:
        """Return once it holds. Raises `CanaxisError` where that can't be told any more."""
        ...


class InputWait(Operation):
    """A wait for one input of a node. It holds no axis and moves nothing."""

    noun = "wait"

    def __init__(
        self,
        node: NodeLink,
        condition: Condition,
        timeout_s: float,
        on_change: Callable[[Operation], None],
        operation_id: str | None = None,
    ) -> None:
        super().__init__(MotionKind.WAIT_INPUT, (), on_change, operation_id, node_id=node.node_id)
        self.condition = condition
        self.timeout_s = timeout_s

    async def cancel(self) -> None:
        """End it; nothing is stopped, since nothing moves for it."""
        self.give_up("It was cancelled on request.")


class Waits:
    """The waits that run on one node."""

    def __init__(self, node: NodeLink) -> None:
        self._node = node
        self._running: dict[Operation, asyncio.Task[None]] = {}

    def begin(self, condition: Condition, timeout_s: float, *, operation_id: str | None = None) -> InputWait:
        """Begin to wait. Raises `NodeAway`, `BadValue`, and `NotReady` where too many wait already."""
        node = self._node
        if not 0 < timeout_s <= LONGEST:
            raise BadValue(f"timeout_s must be above 0 and at most {LONGEST:g}.", node=node.node_id)
        node.require_operational()
        if len(self._running) >= MOST:
            obstacle = TOO_MANY_WAITS.found(f"{MOST} waits run on node {node.name} already.")
            raise NotReady(obstacle.message, obstacles=(obstacle,), node=node.node_id)
        wait = InputWait(node, condition, timeout_s, self._on_change, operation_id)
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
                result = await wait.condition.reached()
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

    def _on_change(self, wait: Operation) -> None:
        self._node.backbone.events.publish("motion", node=self._node.node_id, data={"motion": wait})
        task = self._running.get(wait) if wait.done else None
        if task is not None and task is not asyncio.current_task():
            task.cancel()
