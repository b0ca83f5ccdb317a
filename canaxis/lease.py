"""Leases: exclusive control of axes for the length of a `with`, renewed in the background."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Sequence
from types import TracebackType
from typing import TypeVar

from canaxis import calls
from canaxis.async_client import AsyncClient
from canaxis.client import Client
from canaxis.errors import CanaxisError, LeaseLost, Locked, NotFound
from canaxis.exchange import Call
from canaxis.replies import LeaseGranted
from canaxis.stream import AxisName

T = TypeVar("T")
SHARE = 3.0
"""How many renewals a TTL has room for."""


class Holding:
    """What is known of a lease: its id and token once it was taken, and whether it is still held."""

    def __init__(self, ttl: float) -> None:
        self.ttl = ttl
        self.id = ""
        self.token = ""
        self.lost = False
        self._renewed = 0.0

    def took(self, granted: LeaseGranted, asked_at: float) -> None:
        """It was granted; it lasts from when it was asked for, at least."""
        self.id, self.token, self._renewed = granted.id, granted.token, asked_at

    def renewed(self, asked_at: float) -> None:
        """So was a renewal."""
        self._renewed = asked_at

    def failed(self, error: CanaxisError) -> None:
        """A renewal wasn't; the next one may be in time still."""
        if isinstance(error, Locked | NotFound) or time.monotonic() - self._renewed >= self.ttl:
            self.lost = True

    def check(self, call: Call[T]) -> None:
        """Before a call is made. Raises `LeaseLost` for a command under a lease that is known to be lost."""
        if self.lost and not call.request.safe:
            raise LeaseLost(
                "The lease is not held any more.",
                hint="Its axes were stopped, unless it was released. Look at them, then take a new lease.",
                code="lease_lost",
            )


class Lease(Client):
    """A client whose commands are sent under a lease: take nodes and axes from it, not from the client."""

    def __init__(
        self, client: Client, axes: Sequence[AxisName], ttl: float, owner: str | None, force: bool
    ) -> None:
        super().__init__(
            client._url,
            timeout=client._timeout,
            patience=client._patience,
            http=client._http,
            sleep=client._sleep,
        )
        self._headers = dict(client._headers)
        self._holding = Holding(ttl)
        self._take = calls.take_lease(axes, ttl, owner, force=force)
        self._over = threading.Event()
        self._renewing = threading.Thread(target=self._renew, name="lease", daemon=True)

    def __enter__(self) -> Lease:
        asked_at = time.monotonic()
        self._holding.took(super().run(self._take), asked_at)
        self._headers["Lease"] = self._holding.token
        self._renewing.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release it. What runs is stopped if an exception left the `with`, and goes on otherwise."""
        self._over.set()
        self._renewing.join()
        with contextlib.suppress(CanaxisError):  # then it ended by itself, or will
            super().run(calls.release_lease(self._holding.id, stop=error is not None))

    @property
    def lost(self) -> bool:
        """Whether it is known to be held no more."""
        return self._holding.lost

    def run(self, call: Call[T]) -> T:
        """Make a call. Raises `LeaseLost` for a command once the lease is lost."""
        self._holding.check(call)
        return super().run(call)

    def _renew(self) -> None:
        while not self._over.wait(self._holding.ttl / SHARE) and not self._holding.lost:
            asked_at = time.monotonic()
            try:
                super().run(calls.renew_lease(self._holding.id))
            except CanaxisError as error:
                self._holding.failed(error)
            else:
                self._holding.renewed(asked_at)


class AsyncLease(AsyncClient):
    """As `Lease`, for an event loop."""

    def __init__(
        self, client: AsyncClient, axes: Sequence[AxisName], ttl: float, owner: str | None, force: bool
    ) -> None:
        super().__init__(
            client._url,
            timeout=client._timeout,
            patience=client._patience,
            http=client._http,
            sleep=client._sleep,
        )
        self._headers = dict(client._headers)
        self._holding = Holding(ttl)
        self._take = calls.take_lease(axes, ttl, owner, force=force)
        self._renewing: asyncio.Task[None] | None = None

    async def __aenter__(self) -> AsyncLease:
        asked_at = time.monotonic()
        self._holding.took(await super().run(self._take), asked_at)
        self._headers["Lease"] = self._holding.token
        self._renewing = asyncio.create_task(self._renew(), name="lease")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release it. What runs is stopped if an exception left the `with`, and goes on otherwise."""
        if self._renewing is not None:
            self._renewing.cancel()
            await asyncio.wait({self._renewing})
        with contextlib.suppress(CanaxisError):  # then it ended by itself, or will
            await super().run(calls.release_lease(self._holding.id, stop=error is not None))

    @property
    def lost(self) -> bool:
        """Whether it is known to be held no more."""
        return self._holding.lost

    async def run(self, call: Call[T]) -> T:
        """Make a call. Raises `LeaseLost` for a command once the lease is lost."""
        self._holding.check(call)
        return await super().run(call)

    async def _renew(self) -> None:
        while not self._holding.lost:
            await asyncio.sleep(self._holding.ttl / SHARE)
            asked_at = time.monotonic()
            try:
                await super().run(calls.renew_lease(self._holding.id))
            except CanaxisError as error:
                self._holding.failed(error)
            else:
                self._holding.renewed(asked_at)
