"""How many requests a client may send in a second."""

from __future__ import annotations

import time
from collections.abc import Callable

BURST = 1.0
"""Seconds' worth of requests that may come at once."""
CLIENTS = 10_000
"""Clients that are remembered; beyond that, those that have been quiet are forgotten."""


class RateLimit:
    """A leaky bucket for each client, kept as one number: when it will have run dry (GCRA)."""

    def __init__(self, per_second: float, now: Callable[[], float] = time.monotonic) -> None:
        self._interval = 1.0 / per_second
        self._now = now
        self._dry: dict[str, float] = {}

    def delay(self, client: str) -> float:
        """0.0 if a request may pass, and it is counted; else the seconds after which the next one may."""
        now = self._now()
        dry = max(self._dry.get(client, now), now)
        early = dry - now - BURST
        if early > 0:
            return early
        self._dry[client] = dry + self._interval
        if len(self._dry) > CLIENTS:
            self._forget(now)
        return 0.0

    def _forget(self, now: float) -> None:
        """Forget the quiet ones; if there are none, all: better to let pass than to grow without bound."""
        self._dry = {client: dry for client, dry in self._dry.items() if dry > now}
        if len(self._dry) > CLIENTS:
            self._dry.clear()
