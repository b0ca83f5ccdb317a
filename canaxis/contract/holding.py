"""A lease as its holder knows it: id, token, and whether it is still held."""

from __future__ import annotations

from typing import TypeVar

from canaxis.contract.exchange import Call
from canaxis.errors import CanaxisError, LeaseLost, Locked, NotFound
from canaxis.replies.lease import LeaseGranted

T = TypeVar("T")
SHARE = 3.0
"""How many renewals a TTL has room for."""


class Holding:
    """What is known of a lease; every time is one of the same monotonic clock, in seconds."""

    def __init__(self, ttl: float) -> None:
        self.id = ""
        self.token = ""
        self.lost = False
        self._ttl = ttl
        self._renewed = 0.0

    @property
    def pause(self) -> float:
        """Seconds between two renewals."""
        return self._ttl / SHARE

    def took(self, granted: LeaseGranted, asked_at: float) -> None:
        """It was granted; it lasts from when it was asked for, at least."""
        self.id, self.token, self._renewed = granted.id, granted.token, asked_at

    def renewed(self, asked_at: float) -> None:
        """So was a renewal."""
        self._renewed = asked_at

    def failed(self, error: CanaxisError, now: float) -> None:
        """A renewal wasn't; the next one may be in time still."""
        if isinstance(error, Locked | NotFound) or now - self._renewed >= self._ttl:
            self.lost = True

    def check(self, call: Call[T]) -> None:
        """Before a call is made. Raises `LeaseLost` for a command under a lease that is known to be lost."""
        if self.lost and not call.request.safe:
            raise LeaseLost(
                "The lease is not held any more.",
                hint="Its axes were stopped, unless it was released. Look at them, then take a new lease.",
                code="lease_lost",
            )
