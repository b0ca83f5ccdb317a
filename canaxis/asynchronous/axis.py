"""An axis of a module, by number or name."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Mapping
from typing import Any, Unpack

from canaxis.asynchronous.carrier import AsyncCarrier
from canaxis.asynchronous.jog import AsyncJog
from canaxis.asynchronous.operation import AsyncOperation
from canaxis.contract.calls import AxisCalls
from canaxis.contract.options import (
    GoOptions,
    HomeOptions,
    MoveOptions,
    SetPositionOptions,
    TeachOptions,
    VelocityOptions,
)
from canaxis.contract.stream import AxisName, Sample
from canaxis.replies.axis import AxisStatus, Readiness
from canaxis.replies.positions import NamedPosition
from canaxis.replies.preview import Preview
from canaxis.replies.settings import AxisSettings


class AsyncAxis:
    """An axis of a module, by number or name."""

    def __init__(self, client: AsyncCarrier, node: int | str, axis: int | str) -> None:
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

    def jog(self) -> AsyncJog:
        """A connection that turns the axis while it is held; use it in a block. Needs `websockets`."""
        return self._client.jog(self._calls.path)

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
        found = await self._client.run(self._calls.positions())
        return found.positions

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
