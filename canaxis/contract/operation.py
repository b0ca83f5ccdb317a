"""An operation as both clients see it, and how its end is waited for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from canaxis.contract.calls import OperationCalls
from canaxis.contract.exchange import Exchange, Patience
from canaxis.errors import CanaxisError, OperationCancelled, WaitTimeout, of_problem
from canaxis.replies import Evidence, OperationStatus

LONG_POLL = 20.0
"""Seconds that one request waits at the service; a longer wait is several of them."""


class OperationView:
    """What was last heard of an operation. It goes on whoever looks at it, and whoever stops looking."""

    def __init__(self, status: OperationStatus) -> None:
        self._status = status
        self._calls = OperationCalls(status.id)

    @property
    def status(self) -> OperationStatus:
        """All that the service said when it was last asked."""
        return self._status

    @property
    def id(self) -> str:
        """Unique, also over restarts of the service."""
        return self._status.id

    @property
    def kind(self) -> str:
        """move, velocity, home ..."""
        return self._status.kind

    @property
    def state(self) -> str:
        """queued, running, succeeded, failed or cancelled."""
        return self._status.state

    @property
    def done(self) -> bool:
        """Whether it ended, in whatever way."""
        return self._status.done

    @property
    def progress(self) -> float | None:
        """0 to 1, where it can be told."""
        return self._status.progress

    @property
    def result(self) -> Mapping[str, Any] | None:
        """What came of it, once it succeeded."""
        return self._status.result

    @property
    def evidence(self) -> Evidence:
        """What was seen of the axes meanwhile: start, target and end, statuswords, emergencies."""
        return self._status.evidence

    @property
    def error(self) -> CanaxisError | None:
        """Why it failed or was cancelled; None while it didn't."""
        if self.state == "cancelled":
            return OperationCancelled(
                self._status.reason or "The operation was cancelled.",
                hint="Look at the axis's status before you command it again.",
                code="cancelled",
            )
        if self.state == "failed":
            reason = self._status.reason or "The operation failed."
            return of_problem(self._status.error or {"detail": reason})
        return None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.kind} {self.id} {self.state}>"

    def _ended(self, timeout: float | None, patience: Patience) -> Exchange[None]:
        """Ask until it ended; raises why it did not come to its goal, or `WaitTimeout`."""
        left = timeout
        while not self.done:
            if left is not None and left <= 0:
                raise WaitTimeout(
                    f"Operation {self.id} is {self.state} after {timeout:g} s.",
                    hint="It goes on: wait again, or cancel it.",
                )
            wait = LONG_POLL if left is None else min(left, LONG_POLL)
            self._status = yield from self._calls.status(wait).exchange(patience)
            left = None if left is None else left - wait
        if self.error is not None:
            raise self.error
