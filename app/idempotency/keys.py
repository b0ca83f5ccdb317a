"""Idempotency keys: what was sent under them, and what came of it, over restarts of the service.

A key is written down in the same transaction as the operation that is begun under it, or by itself before a
command that is none is carried out; its answer follows. So at every instant at which the service may die, the
store tells whether something may have been sent under a key, and what became of it.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from app.http.paths import operation_path
from app.http.problems import problem
from app.http.replies import problem_response
from app.idempotency import table as rows
from app.store.database import Database, StoreOff
from app.store.sqlite import Statement

LIFETIME = 24 * 3600.0
CAPACITY = 10_000
"""Answers that are held in memory."""
KEPT = 100_000
"""Keys that the store remembers."""
PRUNE_EACH = 500
"""New keys after which the store forgets what is too old or too much."""

Headers = list[tuple[bytes, bytes]]


@dataclass(slots=True)
class Record:
    """A key's request, and the answer once there is one."""

    fingerprint: bytes
    born: float
    """By the monotonic clock."""
    status: int | None = None
    headers: Headers = field(default_factory=Headers)
    body: bytes = b""
    spent: bool = False
    """Whether a command took it: from then on it may have been carried out."""

    @property
    def answered(self) -> bool:
        """Whether the answer is known."""
        return self.status is not None


class Claim:
    """The key of one request, for whoever carries the command out."""

    def __init__(self, keys: Keys, key: str, record: Record) -> None:
        self.key = key
        self.record = record
        self._keys = keys

    def spend(self) -> tuple[Statement, ...]:
        """What to write in one transaction with what is begun under the key; nothing if that was done."""
        if self.record.spent:
            return ()
        self.record.spent = True
        return self._keys.spent(self.key, self.record)

    async def write_down(self) -> None:
        """Spend the key by itself and wait until that is durable, or the store is off."""
        await self._keys.write(*self.spend())


class Keys:
    """Keys of the last 24 hours: in memory, and in the store once there is one.

    While the store is off, keys are held in memory alone and don't outlive the service.
    """

    def __init__(
        self,
        capacity: int = CAPACITY,
        lifetime: float = LIFETIME,
        now: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
        kept: int = KEPT,
    ) -> None:
        self._capacity = capacity
        self._lifetime = lifetime
        self._now = now
        self._wall = wall
        self._kept = kept
        self._records: OrderedDict[str, Record] = OrderedDict()
        self._elsewhere: OrderedDict[str, float] = OrderedDict()
        """Keys that the store alone has: of earlier runs, or pushed out of memory; with their births."""
        self._store: Database | None = None
        self._loaded = False
        self._since_pruning = PRUNE_EACH

    async def open(self, store: Database) -> None:
        """Go on with what the store has. Operations that a restart ended must be marked as failed before."""
        self._store = store
        self._loaded = False
        store.on_return.append(self._write_anew)
        await self._load()

    # --- for the middleware ---

    async def find(self, key: str) -> Record | None:
        """The record of a key that is not yet too old. Raises `StoreOff` if it is known but can't be read.

        Where it returns None, nothing was awaited since it was seen that there is none.
        """
        if not self._loaded:
            await self._load()
        known = self._here(key)
        if known is not None or key not in self._elsewhere or self._store is None:
            return known
        stored = await rows.find(self._store, key, self._wall() - self._lifetime)
        known = self._here(key)
        if known is None and stored is not None:
            return Record(stored.fingerprint, self._now(), stored.status, stored.headers, stored.body, True)
        return known

    def begin(self, key: str, fingerprint: bytes) -> Claim:
        """Note that a request with this key begins; the oldest answered one leaves memory if it is full."""
        self._elsewhere.pop(key, None)
        record = self._records[key] = Record(fingerprint, self._now())
        if len(self._records) > self._capacity:
            oldest = next((k for k, r in self._records.items() if r.answered), None)
            if oldest is not None:
                del self._records[oldest]
                self._note_elsewhere(oldest)
        return Claim(self, key, record)

    def settle(self, claim: Claim, status: int, headers: Headers, body: bytes) -> None:
        """Note the answer; a key under which nothing was carried out is free again."""
        record = claim.record
        if self._records.get(claim.key) is not record or record.answered:
            return
        if not record.spent or 400 <= status < 500 or status == 503:
            del self._records[claim.key]
            if record.spent:
                self._later(rows.freed(claim.key))
            return
        record.headers, record.body, record.status = headers, body, status
        self._later(rows.answered(claim.key, status, headers, body))

    # --- for the claims ---

    def spent(self, key: str, record: Record) -> tuple[Statement, ...]:
        """What to write of a key that is just spent."""
        self._since_pruning += 1
        if self._since_pruning >= PRUNE_EACH:
            self._since_pruning = 0
            self._later(*rows.pruned(self._wall() - self._lifetime, self._kept))
        return (rows.begun(key, self._born(record), record.fingerprint),)

    async def write(self, *statements: Statement) -> None:
        """Write, and wait until it is durable or the store is off."""
        if self._store is not None:
            await self._store.commit(*statements)

    # --- inside ---

    def _here(self, key: str) -> Record | None:
        record = self._records.get(key)
        if record is not None and record.answered and self._now() - record.born > self._lifetime:
            del self._records[key]
            return None
        return record

    def _born(self, record: Record) -> float:
        return self._wall() - (self._now() - record.born)

    def _note_elsewhere(self, key: str) -> None:
        if self._store is None:
            return
        self._elsewhere[key] = self._wall()
        if len(self._elsewhere) > self._kept:
            self._elsewhere.popitem(last=False)

    def _later(self, *statements: Statement) -> None:
        if self._store is not None:
            self._store.later(*statements)

    async def _load(self) -> None:
        """Learn the keys of earlier runs, and answer those that were in flight when the service died."""
        if self._store is None or not self._store.health.on:
            return
        since = self._wall() - self._lifetime
        try:
            unanswered = await rows.unanswered(self._store, since)
            names = await rows.names(self._store, since, self._kept)
        except StoreOff:
            return
        if self._loaded:
            return
        self._loaded = True
        for key, born in names:
            if key not in self._records:
                self._elsewhere[key] = born
        for row in unanswered:
            if row.key not in self._records:
                self._later(_answer_of_a_restart(row))

    def _write_anew(self) -> None:
        """The store works again: write what it missed as far as it is still held here."""
        statements: list[Statement] = []
        for key, record in self._records.items():
            if record.spent:
                statements.append(rows.begun(key, self._born(record), record.fingerprint))
            if record.spent and record.status is not None:
                statements.append(rows.answered(key, record.status, record.headers, record.body))
        self._later(*statements)


def _answer_of_a_restart(row: rows.Unanswered) -> Statement:
    """What became of a key whose request the service's end cut off: its operation, or nobody knows."""
    if row.operation_id is not None and row.document is not None:
        headers = [(b"content-type", b"application/json")]
        headers.append((b"location", operation_path(row.operation_id).encode()))
        return rows.answered(row.key, 200, headers, row.document.encode())
    reply = problem(
        "service_restarted",
        "The service ended while it carried this command out; whether it took effect is not known.",
        hint="Look at the axis's status; if the command is still wanted, send it with a new key.",
    )
    response = problem_response(reply)
    return rows.answered(row.key, reply.status, response.raw_headers, bytes(response.body))
