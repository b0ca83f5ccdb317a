"""The client for an event loop: `Client` with `await`."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar, Unpack

import httpx

from canaxis import calls, stream
from canaxis.calls import (
    AnalogOptions,
    AxisCalls,
    GoOptions,
    HomeOptions,
    MoveOptions,
    NodeCalls,
    SetPositionOptions,
    Target,
    TeachOptions,
    TogetherOptions,
    VelocityOptions,
    WaitOptions,
)
from canaxis.exchange import Answer, Call, Exchange, Patience, Request
from canaxis.obstacles import Action
from canaxis.operation import OperationView
from canaxis.path import AnyPoints, Axes, PathBody
from canaxis.replies import (
    AxisSettings,
    AxisStatus,
    BusStatus,
    Emergency,
    Inputs,
    MovesPrediction,
    NamedPosition,
    NodeStatus,
    ObjectValue,
    OperationStatus,
    Output,
    Preview,
    Readiness,
    Ready,
    StopReport,
    StopState,
)
from canaxis.stream import AxisName, Following, Sample

if TYPE_CHECKING:
    from canaxis.lease import AsyncLease

T = TypeVar("T")
TIMEOUT = 30.0


class AsyncClient:
    """A Canaxis service. Use it in an `async with`, or `close()` it; neither stops a motor.

    `token`: the bearer token, where the service wants one. `timeout`: seconds that an answer may take, beyond
    what the service is asked to wait. `patience`: how long a request without an answer is repeated. Proxies
    and certificates are taken from no environment variable; give `http` a client of your own for those
    (its `base_url` and its headers are left alone, and it is not closed).

    An `AsyncClient` may be shared by tasks. Every method raises `CanaxisError`.
    """

    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        timeout: float = TIMEOUT,
        patience: Patience | None = None,
        http: httpx.AsyncClient | None = None,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._url = url.rstrip("/")
        self._headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._timeout = timeout
        self._patience = patience or Patience()
        self._http = http or httpx.AsyncClient(trust_env=False)
        self._owned = http is None
        self._sleep = sleep

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections. What moves goes on moving: see `stop_all`."""
        if self._owned:
            await self._http.aclose()

    def node(self, node: int | str) -> AsyncNode:
        """The node of that ID or name; nothing is asked yet."""
        return AsyncNode(self, node)

    async def nodes(self) -> tuple[NodeStatus, ...]:
        """Every configured node, whether it is there or not."""
        return (await self.run(calls.nodes())).nodes

    async def operation(self, operation: str) -> AsyncOperation:
        """The operation of that id."""
        return AsyncOperation(self, await self.run(calls.OperationCalls(operation).status()))

    async def operations(
        self, *, limit: int = 100, state: str | None = None, before: str | None = None
    ) -> list[AsyncOperation]:
        """Operations, the newest first; `before` an operation's id, for the next page."""
        found = (await self.run(calls.operations(limit, state, before))).operations
        return [AsyncOperation(self, status) for status in found]

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
        from canaxis.lease import AsyncLease

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

    async def stream(self, *axes: AxisName) -> AsyncGenerator[Sample]:
        """What axes do as it happens: ``("stage", "x")`` and so on, or every axis. Never ends by itself.

        First where each axis is, then each change, some fifty a second at most. The connection is made anew
        when it breaks; `Sample.gap` tells of what was missed. Raises `UnknownAxis`, and `ServiceUnreachable`
        once no event came for as long as the patience lasts.
        """
        following = Following(axes, self._patience)
        while True:
            broke = None
            try:
                request = self._build(following.request(), stream.TIMEOUT)
                response = await self._http.send(request, stream=True)
                async with contextlib.aclosing(response):
                    if not response.is_success:
                        await response.aread()
                    following.opened(response)
                    async for chunk in response.aiter_bytes():
                        for sample in following.take(chunk):
                            yield sample
            except httpx.TransportError as error:
                broke = error
            await self._sleep(following.pause(broke))

    async def trajectory(
        self, axes: Axes, points: AnyPoints, *, cycle_ms: int = 10, key: str | None = None
    ) -> AsyncOperation:
        """Have axes of one bus follow a path: points of ``(seconds, positions)`` or ``(seconds, positions,
        velocities)``, in the units of `axes`, each ``(node, axis, unit)``.

        The points are sent as they come, so a generator may give a million (an asynchronous one with
        `AsyncClient`); the service begins once it has all of them. Only a list, no generator, can be
        sent again should the answer be lost.
        """
        body = PathBody(axes, points, cycle_ms)
        return AsyncOperation(self, await self.run(calls.trajectory(body, key)))

    # --- what the handles stand on ---

    async def run(self, call: Call[T]) -> T:
        """Make a call, repeating it as `Patience` says."""
        return await self.carry_out(call.exchange(self._patience))

    async def carry_out(self, exchange: Exchange[T]) -> T:
        """Send what an exchange wants sent, until it has its result."""
        try:
            step = next(exchange)
            while True:
                if step.pause > 0:
                    await self._sleep(step.pause)
                step = exchange.send(await self._answer(step.request))
        except StopIteration as end:
            return end.value

    @property
    def patience(self) -> Patience:
        """How long a request without an answer is repeated."""
        return self._patience

    async def _answer(self, request: Request) -> Answer:
        try:
            return await self._http.send(self._build(request, request.timeout(self._timeout)))
        except httpx.TransportError as error:
            return error

    def _build(self, request: Request, timeout: httpx.Timeout) -> httpx.Request:
        return self._http.build_request(
            request.method,
            self._url + request.path,
            params=dict(request.query) or None,
            json=request.body,
            content=None if request.path_body is None else request.path_body.async_pieces(),
            headers={**self._headers, **request.headers},
            timeout=timeout,
        )


class AsyncNode:
    """A module, by ID or name."""

    def __init__(self, client: AsyncClient, node: int | str) -> None:
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
        return (await self._client.run(self._calls.axes())).axes

    async def emergencies(self) -> tuple[Emergency, ...]:
        """The node's last emergencies with cause and remedy, the newest first."""
        return (await self._client.run(self._calls.emergencies())).emergencies

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
        return (await self._client.run(self._calls.outputs())).outputs

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


class AsyncAxis:
    """An axis of a module, by number or name."""

    def __init__(self, client: AsyncClient, node: int | str, axis: int | str) -> None:
        self._client = client
        self._name: AxisName = (node, axis)
        self._calls = AxisCalls(node, axis)

    async def status(self) -> AxisStatus:
        """What the axis does now, with its age."""
        return await self._client.run(self._calls.status())

    async def readiness(self) -> Readiness:
        """What prevents each command now, each reason with its remedy."""
        return await self._client.run(self._calls.readiness())

    async def enable(self) -> AxisStatus:
        """Switch the power stage on: the axis holds its position from then on."""
        return await self._client.run(self._calls.enable())

    async def disable(self) -> AxisStatus:
        """Ramp down, then switch off: the motor holds no torque any more."""
        return await self._client.run(self._calls.disable())

    async def reset_fault(self) -> AxisStatus:
        """Acknowledge the fault. The axis stays disabled until it is enabled again."""
        return await self._client.run(self._calls.reset_fault())

    async def move(self, target: float, unit: str, **options: Unpack[MoveOptions]) -> AsyncOperation:
        """Go to a position in `unit` (`steps` are whole), or by a distance. The answer is its beginning."""
        return AsyncOperation(self._client, await self._client.run(self._calls.move(target, unit, options)))

    async def velocity(
        self, velocity: float, unit: str, **options: Unpack[VelocityOptions]
    ) -> AsyncOperation:
        """Run at a speed in `unit`/s until something else is commanded, or to an end that is given too."""
        return AsyncOperation(
            self._client, await self._client.run(self._calls.velocity(velocity, unit, options))
        )

    async def home(self, **options: Unpack[HomeOptions]) -> AsyncOperation:
        """Seek the reference."""
        return AsyncOperation(self._client, await self._client.run(self._calls.home(options)))

    async def predict_move(self, target: float, unit: str, **options: Unpack[MoveOptions]) -> Preview:
        """What a move would come to: duration, way, what prevents it. Nothing is sent to the axis."""
        return await self._client.run(self._calls.predict_move(target, unit, options))

    async def predict_velocity(
        self, velocity: float, unit: str, **options: Unpack[VelocityOptions]
    ) -> Preview:
        """The same of running at a speed."""
        return await self._client.run(self._calls.predict_velocity(velocity, unit, options))

    async def predict_home(self, **options: Unpack[HomeOptions]) -> Preview:
        """The same of seeking the reference: the longest that it may take."""
        return await self._client.run(self._calls.predict_home(options))

    async def go(self, position: str, **options: Unpack[GoOptions]) -> AsyncOperation:
        """Go to a position by its name, as `teach` gave it. The answer is its beginning."""
        return AsyncOperation(self._client, await self._client.run(self._calls.go(position, options)))

    async def set_position(
        self, position: float, unit: str, **options: Unpack[SetPositionOptions]
    ) -> AsyncOperation:
        """Say where the standing axis is; nothing moves, and it counts as homed then."""
        return AsyncOperation(
            self._client, await self._client.run(self._calls.set_position(position, unit, options))
        )

    async def settings(self) -> AxisSettings:
        """What the axis is set to, every number with its unit."""
        return await self._client.run(self._calls.settings())

    async def configure(self, changes: Mapping[str, Any], seen: AxisSettings | None = None) -> AxisSettings:
        """Change settings: what is left out stays, None brings a default back. Read back, kept, gone by.

        `seen`: the settings from which the change was made; raises `PreconditionFailed` if they are others
        now. Without it, those of this moment.
        """
        seen = await self.settings() if seen is None else seen
        return await self._client.run(self._calls.configure(changes, seen.etag))

    async def positions(self) -> tuple[NamedPosition, ...]:
        """The named positions of the axis, by name."""
        return (await self._client.run(self._calls.positions())).positions

    async def teach(self, name: str, **options: Unpack[TeachOptions]) -> NamedPosition:
        """Give a position a name: where the axis stands, or `position` in `unit`."""
        return await self._client.run(self._calls.teach(name, options))

    async def forget_position(self, name: str) -> NamedPosition:
        """Forget a named position; returns what it was."""
        return await self._client.run(self._calls.forget_position(name))

    async def stop(self) -> AxisStatus:
        """Ramp down and stay enabled; ends the running operation. Answers at standstill."""
        return await self._client.run(self._calls.stop())

    async def quick_stop(self) -> AxisStatus:
        """Ramp down as fast as the drive can, then switch off."""
        return await self._client.run(self._calls.quick_stop())

    def stream(self) -> AsyncGenerator[Sample]:
        """What the axis does as it happens: see `AsyncClient.stream`."""
        return self._client.stream(self._name)


class AsyncOperation(OperationView):
    """A command that takes time."""

    def __init__(self, client: AsyncClient, status: OperationStatus) -> None:
        super().__init__(status)
        self._client = client

    async def refresh(self) -> AsyncOperation:
        """Ask how far it is."""
        self._status = await self._client.run(self._calls.status())
        return self

    async def wait(self, timeout: float | None = None) -> AsyncOperation:  # noqa: ASYNC109 - as Operation's
        """Wait for its end, at most `timeout` seconds. It goes on if the waiting is given up or interrupted.

        Raises what it failed with, `OperationCancelled`, or `WaitTimeout`.
        """
        await self._client.carry_out(self._ended(timeout, self._client.patience))
        return self

    async def cancel(self) -> AsyncOperation:
        """Controlled stop of what it moves; answers at standstill. Does nothing if it ended already."""
        self._status = await self._client.run(self._calls.cancel())
        return self
