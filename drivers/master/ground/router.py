"""From a COB-ID to the one handler that wants it.

Synchronous; never awaits; a bad frame is counted, never raised.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from drivers.bus.frame import Frame
from drivers.master.ground.counters import NetworkCounters

Handler = Callable[[Frame], None]


class Router:
    """The table of handlers.

    An error in a handler is a bug: it goes to `on_bug`, and the next frame is handled.
    """

    def __init__(self, counters: NetworkCounters, on_bug: Callable[[Exception], None]) -> None:
        self._counters = counters
        self._on_bug = on_bug
        self._handlers: dict[int, Handler] = {}

    def add(self, cob_id: int, handler: Handler) -> None:
        """Send frames with `cob_id` to `handler`. Raises ValueError if it is taken."""
        if cob_id in self._handlers:
            raise ValueError(f"COB-ID {cob_id:03X}h has a handler already")
        self._handlers[cob_id] = handler

    def dispatch(self, frames: Sequence[Frame]) -> None:
        """Hand each frame to its handler, in order."""
        counters = self._counters
        handlers = self._handlers
        counters.received += len(frames)
        for frame in frames:
            if frame.error:  # first: its identifier is a set of flags that can look like any COB-ID
                counters.error_frames += 1
            elif frame.extended:
                counters.extended_frames += 1
            elif frame.remote:
                counters.remote_frames += 1
            else:
                handler = handlers.get(frame.cob_id)
                if handler is None:
                    counters.unrouted += 1
                    continue
                try:
                    handler(frame)
                except Exception as bug:
                    self._on_bug(bug)
