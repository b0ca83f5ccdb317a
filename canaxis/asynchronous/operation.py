"""A command that takes time: asked after, waited for, cancelled."""

from __future__ import annotations

from canaxis.asynchronous.carrier import AsyncCarrier
from canaxis.contract.operation import OperationView
from canaxis.replies.operation import OperationStatus


class AsyncOperation(OperationView):
    """A command that takes time."""

    def __init__(self, client: AsyncCarrier, status: OperationStatus) -> None:
        super().__init__(status)
        self._client = client

    async def refresh(self) -> AsyncOperation:
        """Ask how far it is."""
        self._status = await self._client.run(self._calls.status())
        return self

    async def wait(self, timeout: float | None = None) -> AsyncOperation:
        """Wait for its end, at most `timeout` seconds. It goes on if the waiting is given up or interrupted.

        Raises what it failed with, `OperationCancelled`, or `WaitTimeout`.
        """
        await self._client.carry_out(self._ended(timeout, self._client.patience))
        return self

    async def cancel(self) -> AsyncOperation:
        """Controlled stop of what it moves; answers at standstill. Does nothing if it ended already."""
        self._status = await self._client.run(self._calls.cancel())
        return self
