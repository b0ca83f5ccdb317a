"""The handlers that one bus calls, kept apart from each other's mistakes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from drivers.bus.base import BusState, FrameHandler, StateHandler
from drivers.bus.frame import Frame


class Listeners:
    """Calls each subscriber in the order of subscription.

    A handler that raises is reported to the event loop's exception handler, and the others still get their
    batch: a mistake in one part of the service can't make another part deaf.
    """

    def __init__(self) -> None:
        self._entries: tuple[tuple[FrameHandler, StateHandler | None], ...] = ()

    def subscribe(self, on_frames: FrameHandler, on_state: StateHandler | None = None) -> Callable[[], None]:
        """Add a pair of handlers; returns the function that takes it out again (idempotent)."""
        entry = (on_frames, on_state)
        self._entries = (*self._entries, entry)

        def end() -> None:
            self._entries = tuple(other for other in self._entries if other is not entry)

        return end

    def frames(self, batch: Sequence[Frame]) -> None:
        """Hand a batch to everyone."""
        for on_frames, _ in self._entries:
            try:
                on_frames(batch)
            except Exception as error:
                _report("a frame handler failed", error)

    def state(self, state: BusState, reason: str) -> None:
        """Tell everyone who wants to know that the state changed."""
        for _, on_state in self._entries:
            if on_state is None:
                continue
            try:
                on_state(state, reason)
            except Exception as error:
                _report("a bus state handler failed", error)


def _report(message: str, error: Exception) -> None:
    asyncio.get_running_loop().call_exception_handler({"message": message, "exception": error})
