# Made by `make client` from canaxis/asynchronous/operation.py: change that.
"""A command that takes time: asked after, waited for, cancelled."""

from __future__ import annotations

from canaxis.blocking.carrier import Carrier
from canaxis.contract.operation import OperationView
from canaxis.replies.operation import OperationStatus


class Operation(OperationView):
    """A command that takes time."""

    def __init__(self, client: Carrier, status: OperationStatus) -> None:
        super().__init__(status)
        self._client = client

    def refresh(self) -> Operation:
        """Ask how far it is."""
        self._status = self._client.run(self._calls.status())
        return self

    def wait(self, timeout: float | None = None) -> Operation:
        """Wait for its end, at most `timeout` seconds. It goes on if the waiting is given up or interrupted.

        Raises what it failed with, `OperationCancelled`, or `WaitTimeout`.
        """
        self._client.carry_out(self._ended(timeout, self._client.patience))
        return self

    def cancel(self) -> Operation:
        """Controlled stop of what it moves; answers at standstill. Does nothing if it ended already."""
        self._status = self._client.run(self._calls.cancel())
        return self
