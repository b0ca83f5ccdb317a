"""The book of leases: who has exclusive control of which axes, until when. Pure; time is an argument.

An axis is in one lease at most. A lease is taken whole or not at all, and ends whole. `app.leases.leases`
keeps the book for the running service.
"""

from __future__ import annotations

import secrets
import uuid
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import TypeAlias

from app.http.problems import ApiError

SHORTEST = 1.0
LONGEST = 3600.0
"""Seconds that a lease may last without being renewed."""
DEFAULT_TTL = 10.0

AxisKey: TypeAlias = tuple[int, int]
"""Node ID and axis number."""


@dataclass(frozen=True, slots=True)
class Lease:
    """Exclusive control of some axes, for a while."""

    id: str
    """For everybody to see."""
    token: str
    """For the holder alone: a command is sent under it."""
    fencing: int
    """Higher than that of every lease before, over restarts too."""
    owner: str
    """Who has it, in the holder's own words."""
    holder: str
    """The name of the bearer token with which it was taken."""
    axes: tuple[AxisKey, ...]
    ttl_s: float
    created: datetime
    ends: float
    """When it expires unless it is renewed, by the clock that the book is asked with."""

    def left(self, now: float) -> float:
        """Seconds until it expires; 0 if it has."""
        return max(0.0, self.ends - now)


def draw(
    fencing: int,
    owner: str,
    holder: str,
    axes: Sequence[AxisKey],
    ttl_s: float,
    created: datetime,
    now: float,
) -> Lease:
    """A lease with an id and a token that nobody can guess."""
    return Lease(
        id=uuid.uuid4().hex,
        token=secrets.token_urlsafe(24),
        fencing=fencing,
        owner=owner,
        holder=holder,
        axes=tuple(dict.fromkeys(axes)),
        ttl_s=ttl_s,
        created=created,
        ends=now + ttl_s,
    )


class LeaseBook:
    """All leases. Whoever asks takes out those that are due (`due`) before."""

    def __init__(self) -> None:
        self._by_id: dict[str, Lease] = {}
        self._by_token: dict[str, Lease] = {}
        self._by_axis: dict[AxisKey, Lease] = {}
        self.next_end: float | None = None
        """When the next one expires; None: there is none."""

    def __len__(self) -> int:
        return len(self._by_id)

    def all(self) -> tuple[Lease, ...]:
        """Every lease."""
        return tuple(self._by_id.values())

    def get(self, lease_id: str) -> Lease | None:
        """The lease of that id."""
        return self._by_id.get(lease_id)

    def of(self, axis: AxisKey) -> Lease | None:
        """The lease that an axis is in."""
        return self._by_axis.get(axis)

    def enter(self, lease: Lease, now: float, *, force: bool = False) -> tuple[Lease, ...]:
        """Enter a lease; returns those that had to end for it. Raises `ApiError` (423) unless `force`."""
        in_the_way = {held.id: held for axis in lease.axes if (held := self._by_axis.get(axis)) is not None}
        if in_the_way and not force:
            raise leased(next(iter(in_the_way.values())), now)
        for held in in_the_way.values():
            self.strike(held)
        self._put(lease)
        return tuple(in_the_way.values())

    def held(self, lease_id: str, token: str | None, now: float) -> Lease:
        """The lease of that id, for its holder. Raises `ApiError` (423) for anybody else, or if it ended."""
        lease = self._by_id.get(lease_id)
        if lease is None or (token is not None and token not in self._by_token):
            raise lost()
        if token != lease.token:
            raise leased(lease, now)
        return lease

    def renew(self, lease: Lease, ttl_s: float | None, now: float) -> Lease:
        """Let it last from now on for `ttl_s`; None: as long as before."""
        lasts = lease.ttl_s if ttl_s is None else ttl_s
        renewed = replace(lease, ttl_s=lasts, ends=now + lasts)
        self._put(renewed)
        return renewed

    def strike(self, lease: Lease) -> None:
        """Take a lease out of the book."""
        del self._by_id[lease.id]
        del self._by_token[lease.token]
        for axis in lease.axes:
            del self._by_axis[axis]
        self._look_ahead()

    def due(self, now: float) -> tuple[Lease, ...]:
        """Take out those that have expired, and return them."""
        if self.next_end is None or now < self.next_end:
            return ()
        expired = tuple(lease for lease in self._by_id.values() if lease.ends <= now)
        for lease in expired:
            self.strike(lease)
        return expired

    def check(self, axes: Iterable[AxisKey], token: str | None, now: float) -> None:
        """Whether a command on these axes may be sent under that token, or under none.

        Raises `ApiError` (423): `lease_lost` for a token that is none of a lease now, even if the axes are
        free, for whoever believes to hold a lease must learn that it doesn't; `leased` for an axis of
        somebody else's lease.
        """
        if token is not None and token not in self._by_token:
            raise lost()
        for axis in axes:
            lease = self._by_axis.get(axis)
            if lease is not None and lease.token != token:
                raise leased(lease, now, axis)

    def _put(self, lease: Lease) -> None:
        self._by_id[lease.id] = lease
        self._by_token[lease.token] = lease
        for axis in lease.axes:
            self._by_axis[axis] = lease
        self._look_ahead()

    def _look_ahead(self) -> None:
        self.next_end = min((lease.ends for lease in self._by_id.values()), default=None)


def leased(lease: Lease, now: float, axis: AxisKey | None = None) -> ApiError:
    """The refusal for whoever is not the holder."""
    left = lease.left(now)
    node, number = axis or lease.axes[0]
    return ApiError(
        "leased",
        f"It is leased to {lease.owner}, for {left:.1f} s unless that is renewed.",
        retry_after=left,
        owner=lease.owner,
        expires_in_s=round(left, 3),
        node=node,
        axis=number,
    )


def lost() -> ApiError:
    """The refusal for whoever holds the lease no more."""
    return ApiError("lease_lost", "The lease under which this was sent is not held any more.")
