"""The client for an event loop, and what it is under a lease."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from types import TracebackType
from typing import TypeVar, Unpack

from canaxis.asynchronous.carrier import AsyncCarrier
from canaxis.asynchronous.node import AsyncNode
from canaxis.asynchronous.operation import AsyncOperation
from canaxis.asynchronous.waiting import Background
from canaxis.contract import calls
from canaxis.contract.exchange import Call
from canaxis.contract.holding import Holding
from canaxis.contract.options import Target, TogetherOptions
from canaxis.contract.path import AnyPoints, Axes, PathBody
from canaxis.contract.stream import AxisName
from canaxis.errors import CanaxisError
from canaxis.obstacles import Action
from canaxis.replies.node import NodeStatus
from canaxis.replies.preview import MovesPrediction
from canaxis.replies.service import BusStatus, Ready, StopReport, StopState

T = TypeVar("T")


class AsyncClient(AsyncCarrier):
    """A Canaxis service. Use it in an `async with`, or `close()` it; neither stops a motor.

    `token`: the bearer token, where the service wants one. `timeout`: seconds that an answer may take, beyond
    what the service is asked to wait. `patience`: how long a request without an answer is repeated. Proxies
    and certificates are taken from no environment variable; give `http` a client of your own for those
    (its `base_url` and its headers are left alone, and it is not closed).

    An `AsyncClient` may be shared by tasks. Every method raises `CanaxisError`.
    """

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    def node(self, node: int | str) -> AsyncNode:
        """The node of that ID or name; nothing is asked yet."""
        return AsyncNode(self, node)

    async def nodes(self) -> tuple[NodeStatus, ...]:
        """Every configured node, whether it is there or not."""
        found = await self.run(calls.nodes())
        return found.nodes

    async def operation(self, operation: str) -> AsyncOperation:
        """The operation of that id."""
        return AsyncOperation(self, await self.run(calls.OperationCalls(operation).status()))

    async def operations(
        self, *, limit: int = 100, state: str | None = None, before: str | None = None
    ) -> list[AsyncOperation]:
        """Operations, the newest first; `before` an operation's id, for the next page."""
        found = await self.run(calls.operations(limit, state, before))
        return [AsyncOperation(self, status) for status in found.operations]

    async def move_together(
        self, targets: Sequence[Target], **options: Unpack[TogetherOptions]
    ) -> AsyncOperation:
        """Start axes of one bus on one SYNC and have them arrive together. The answer is its beginning.

        Whatever stops one axis stops all: see docs/coordinated-moves.md.
        """
        return AsyncOperation(self, await self.run(calls.move_together(targets, options)))

    async def predict_together(
        self, targets: Sequence[Target], **options: Unpack[TogetherOptions]
    ) -> MovesPrediction:
        """What a coordinated move would come to, axis by axis. Nothing is sent to them."""
        return await self.run(calls.predict_together(targets, options))

    async def stop_all(self, reason: str = "Stopped by a client.") -> StopReport:
        """Ramp every axis of every node down, and refuse motion until `reset_stop`.

        A software stop, no emergency stop: see docs/safety.md.
        """
        return await self.run(calls.stop_all(reason))

    async def stop_state(self) -> StopState:
        """Whether motion is refused because everything was stopped."""
        return await self.run(calls.stop_state())

    async def reset_stop(self) -> StopState:
        """Allow motion again. Nothing moves by itself."""
        return await self.run(calls.reset_stop())

    def lease(
        self, *axes: AxisName, ttl: float = 10.0, owner: str | None = None, force: bool = False
    ) -> AsyncLease:
        """Exclusive control of axes, ``("stage", "x")`` and so on, for the length of the block.

        Commands go through the lease that it gives: ``lease.node("stage").axis("x")``. It is renewed in the
        background, expires after `ttl` seconds without that, which stops its axes, and is released at the
        end; an exception that leaves the `with` stops them too. `force` takes over from others. Raises
        `Leased` on entering, `LeaseLost` on the next command once it is lost.
        """
        return AsyncLease(self, axes, ttl, owner, force)

    async def follow(self, action: Action) -> None:
        """Do what takes an obstacle away: `Obstacle.action`, from a readiness or from an error."""
        await self.run(calls.follow(action))

    async def bus(self) -> BusStatus:
        """The wire, and what passed over it."""
        return await self.run(calls.bus())

    async def ready(self) -> Ready:
        """Whether everything that is configured can be commanded, and what is missing."""
        return await self.run(calls.ready())

    async def trajectory(
        self, axes: Axes, points: AnyPoints, *, cycle_ms: int = 10, key: str | None = None
    ) -> AsyncOperation:
        """Have axes of one bus follow a path: points of ``(seconds, positions)`` or ``(seconds, positions,
        velocities)``, in the units of `axes`, each ``(node, axis, unit)``.

        The points are sent as they come, so a generator may give a million (in an event loop an
        asynchronous one too); the service begins once it has all of them. Only a list, no generator, can be
        sent again should the answer be lost.
        """
        body = PathBody(axes, points, cycle_ms)
        return AsyncOperation(self, await self.run(calls.trajectory(body, key)))


class AsyncLease(AsyncClient):
    """A client whose commands are sent under a lease: take nodes and axes from it, not from the client."""

    def __init__(
        self, client: AsyncClient, axes: Sequence[AxisName], ttl: float, owner: str | None, force: bool
    ) -> None:
        super().__init__(
            client._url,
            timeout=client._timeout,
            patience=client._patience,
            http=client._http,
            sleep=client._sleep,
        )
        self._headers = dict(client._headers)
        self._holding = Holding(ttl)
        self._take = calls.take_lease(axes, ttl, owner, force=force)
        self._renewing = Background(self._renew, name="lease")

    async def __aenter__(self) -> AsyncLease:
        asked_at = time.monotonic()
        self._holding.took(await super().run(self._take), asked_at)
        self._headers["Lease"] = self._holding.token
        self._renewing.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release it. What runs is stopped if an exception left the `async with`, and goes on otherwise."""
        await self._renewing.end()
        with contextlib.suppress(CanaxisError):  # then it ended by itself, or will
            await super().run(calls.release_lease(self._holding.id, stop=error is not None))

    @property
    def lost(self) -> bool:
        """Whether it is known to be held no more."""
        return self._holding.lost

    async def run(self, call: Call[T]) -> T:
        """Make a call. Raises `LeaseLost` for a command once the lease is lost."""
        self._holding.check(call)
        return await super().run(call)

    async def _renew(self) -> None:
        while not self._holding.lost and await self._renewing.pause(self._holding.pause):
            asked_at = time.monotonic()
            try:
                await super().run(calls.renew_lease(self._holding.id))
            except CanaxisError as error:
                self._holding.failed(error, time.monotonic())
            else:
                self._holding.renewed(asked_at)
