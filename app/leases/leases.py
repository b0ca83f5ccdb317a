"""Leases in the running service: the clock, what stops when one ends, who is told, what a restart leaves."""

from __future__ import annotations

import asyncio
import enum
import time
from collections.abc import Callable, Coroutine, Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import structlog

from app.access.audit import AuditTrail
from app.http.problems import ApiError
from app.leases.book import AxisKey, Lease, LeaseBook, draw
from app.leases.schemas import LeaseAxis, LeaseLinks, LeaseReply
from app.store import counters
from app.store.database import Database, StoreOff
from drivers.errors import CanaxisError
from drivers.master.axis.axis import Axis
from drivers.master.network import Network

FENCING = "fencing"
"""The counter in the store."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.leases")


class LeaseEnd(enum.StrEnum):
    """How a lease ended."""

    RELEASED = "released"
    EXPIRED = "expired"
    TAKEN_OVER = "taken_over"


Listener = Callable[[Lease, LeaseEnd], None]


def lease_path(lease_id: str) -> str:
    """Where a lease is."""
    return f"/api/v1/leases/{lease_id}"


class Leases:
    """The leases of the service. A restart forgets them: their tokens are lost then."""

    def __init__(
        self,
        network: Network,
        store: Database,
        audit: AuditTrail,
        spawn: Callable[[Coroutine[Any, Any, None]], asyncio.Task[None]],
    ) -> None:
        """`spawn` runs what must end even if the client goes away."""
        self._network = network
        self._store = store
        self._audit = audit
        self._spawn = spawn
        self._book = LeaseBook()
        self._fencing = 0
        self._timer: asyncio.TimerHandle | None = None
        self._listeners: list[Listener] = []
        store.on_return.append(lambda: store.later(counters.written(FENCING, self._fencing)))

    async def open(self) -> None:
        """Go on with the fencing tokens after those of earlier runs.

        Each is at least the wall clock in milliseconds, so that they rise though the store was off for a
        while, and at least one more than the last that is stored, so that they rise though the clock was set
        back.
        """
        try:
            self._fencing = await counters.find(self._store, FENCING)
        except StoreOff:
            self._fencing = 0

    def close(self) -> None:
        """Let none expire any more: the service stops its axes itself."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    # --- for every command ---

    def check(self, axes: Iterable[Axis], token: str | None) -> None:
        """Whether a command on these axes may be given under that token, or under none.

        Raises `ApiError` (423): `leased`, or `lease_lost` for a token that is none of a lease (any more).
        """
        if token is None and not self._book:
            return
        self._expire()
        self._book.check((key(axis) for axis in axes), token, self._now())

    def of(self, axis: Axis) -> Lease | None:
        """The lease that an axis is in."""
        return self._book.of(key(axis))

    def watch(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called, synchronously, with each lease that ends; returns how to end that.

        What is to stop was told to stop by then.
        """
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    # --- for those who hold them ---

    async def take(
        self, axes: Sequence[Axis], *, ttl_s: float, owner: str, holder: str, force: bool = False
    ) -> Lease:
        """Take exclusive control of axes, all or none. What runs on free axes goes on.

        `force` ends the leases that are in the way, whole, and stops their axes; it returns at standstill.
        Raises `ApiError` (423).
        """
        self._expire()
        now = self._now()
        wanted = [key(axis) for axis in axes]
        fencing = max(self._fencing + 1, int(time.time() * 1000))
        lease = draw(fencing, owner, holder, wanted, ttl_s, datetime.now(UTC), now)
        taken_from = self._book.enter(lease, now, force=force)
        self._fencing = fencing
        stops = [self._end(each, LeaseEnd.TAKEN_OVER, stop=True, by=owner) for each in taken_from]
        for each in taken_from:
            entry = {"who": holder, "took_over": each.id, "from": each.owner, "held_by": each.holder}
            self._audit.note({**entry, "for": owner, "lease": lease.id})
        self._arm()
        self._tell("taken", lease)
        await self._store.commit(counters.written(FENCING, fencing))
        await _all(stops)
        return lease

    def renew(self, lease_id: str, token: str | None, ttl_s: float | None) -> Lease:
        """Let a lease last anew. Raises `ApiError` (423)."""
        self._expire()
        now = self._now()
        renewed = self._book.renew(self._book.held(lease_id, token, now), ttl_s, now)
        self._arm()
        return renewed

    async def release(self, lease_id: str, token: str | None, *, stop: bool = False) -> Lease:
        """End a lease. What runs goes on, unless `stop`: then it returns at standstill.

        Raises `ApiError` (423).
        """
        self._expire()
        lease = self._book.held(lease_id, token, self._now())
        self._book.strike(lease)
        stopping = self._end(lease, LeaseEnd.RELEASED, stop=stop)
        self._arm()
        await _all([stopping])
        return replace(lease, ends=self._now())

    # --- looking ---

    def get(self, lease_id: str) -> Lease:
        """The lease of that id. Raises `ApiError` (404)."""
        self._expire()
        lease = self._book.get(lease_id)
        if lease is None:
            raise ApiError("unknown_lease", f"There is no lease {lease_id[:64]!r}, or it ended.")
        return lease

    def all(self) -> list[Lease]:
        """Every lease, the oldest first."""
        self._expire()
        return sorted(self._book.all(), key=lambda lease: lease.fencing)

    def left(self, lease: Lease) -> float:
        """Seconds until a lease expires."""
        return round(lease.left(self._now()), 3)

    def reply(self, lease: Lease) -> LeaseReply:
        """A lease as everybody may see it."""
        left = self.left(lease)
        path = lease_path(lease.id)
        return LeaseReply(
            id=lease.id,
            fencing=lease.fencing,
            owner=lease.owner,
            axes=[LeaseAxis(node=a.node.node_id, axis=a.number, name=a.name) for a in self._axes(lease)],
            ttl_s=lease.ttl_s,
            created=lease.created,
            expires=datetime.now(UTC) + timedelta(seconds=left),
            expires_in_s=left,
            links=LeaseLinks(self=path, renew=f"{path}/renew", release=f"{path}/release"),
        )

    # --- inside ---

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    def _axes(self, lease: Lease) -> list[Axis]:
        return [self._network.node(node).axis(axis) for node, axis in lease.axes]

    def _arm(self) -> None:
        """Wake up when the next lease expires."""
        self.close()
        if self._book.next_end is not None:
            self._timer = asyncio.get_running_loop().call_at(self._book.next_end, self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        self._expire()
        self._arm()

    def _expire(self) -> None:
        for lease in self._book.due(self._now()):
            self._end(lease, LeaseEnd.EXPIRED, stop=True)

    def _end(
        self, lease: Lease, end: LeaseEnd, *, stop: bool, by: str | None = None
    ) -> asyncio.Task[None] | None:
        """What follows from the end of a lease that is out of the book; the halt is sent at once."""
        lease = replace(lease, ends=min(lease.ends, self._now()))
        reason = {
            LeaseEnd.RELEASED: f"{lease.owner} released its lease.",
            LeaseEnd.EXPIRED: f"The lease of {lease.owner} expired.",
            LeaseEnd.TAKEN_OVER: f"{by} took the lease of {lease.owner} over.",
        }[end]
        stopping = None
        if stop:
            axes = self._axes(lease)
            for axis in axes:
                axis.begin_stop(reason)
            stopping = self._spawn(_come_to_rest(axes, reason))
        tell = log.info if end is LeaseEnd.RELEASED else log.warning
        tell("lease ended", how=end.value, owner=lease.owner, by=by, axes=lease.axes, stopped=stop)
        self._tell(end.value, lease, by=by, stopped=stop)
        for listener in tuple(self._listeners):
            listener(lease, end)
        return stopping

    def _tell(self, change: str, lease: Lease, *, by: str | None = None, stopped: bool = False) -> None:
        told = self.reply(lease).model_dump(mode="json")
        self._network.events.publish(
            "lease", data={"change": change, "by": by, "stopped": stopped, "lease": told}
        )


def key(axis: Axis) -> AxisKey:
    """An axis as the book knows it."""
    return axis.node.node_id, axis.number


async def _come_to_rest(axes: Sequence[Axis], reason: str) -> None:
    """Wait for standstill; an axis that can't be seen to stand is told in the log."""
    found = await asyncio.gather(*(axis.stop(reason) for axis in axes), return_exceptions=True)
    for axis, error in zip(axes, found, strict=True):
        if isinstance(error, CanaxisError):
            log.warning(
                "an axis whose lease ended", node=axis.node.node_id, axis=axis.number, error=str(error)
            )
        elif error is not None:
            raise error


async def _all(tasks: Iterable[asyncio.Task[None] | None]) -> None:
    for task in tasks:
        if task is not None:
            await asyncio.shield(task)
