"""One-shot tickets, for a browser's EventSource and WebSocket, which can't send an Authorization header.

A ticket goes into the URL, where a token never does: good once, for a few seconds, and for streams only.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable

from app.access.tokens import Principal, hash_of

LIFETIME = 30.0
"""Seconds in which a ticket must be used."""
CAPACITY = 1000
"""Unused tickets at one time; beyond that the oldest are forgotten."""


class Tickets:
    """Those that were given out and not yet used; kept hashed, like tokens."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._unused: dict[bytes, tuple[float, Principal]] = {}

    def issue(self, holder: Principal) -> str:
        """A new ticket that lets its bearer do what `holder` may."""
        now = self._now()
        for key, (due, _) in tuple(self._unused.items()):  # the oldest come first
            if due > now and len(self._unused) < CAPACITY:
                break
            del self._unused[key]
        ticket = secrets.token_urlsafe(32)
        self._unused[hash_of(ticket)] = (now + LIFETIME, holder)
        return ticket

    def redeem(self, ticket: str) -> Principal | None:
        """Use a ticket up: whose it was; None if it is none, was used before, or came too late."""
        due, holder = self._unused.pop(hash_of(ticket), (0.0, None))
        return holder if due > self._now() else None
