"""All operations: written down before anything is sent, found by their ids.

What runs, and the `KEPT` that ended last, is held here; the store has the rest, and all of it after a
restart. While the store is off, operations go on and are shown from here alone.
"""

from __future__ import annotations

import time
import uuid
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from app.access.schemas import Asker
from app.http import problems
from app.http.problems import ApiError
from app.http.schemas import Problem
from app.idempotency.keys import Claim
from app.operations import evidence
from app.operations import table as records
from app.operations.operation import NOBODY, PLAIN, RegisteredOperation, Results, asked_for
from app.operations.schemas import OperationReply, OperationState
from app.store.database import Database, StoreOff
from drivers.master.axis.axis import Axis
from drivers.master.ground.where import AxisId
from drivers.master.motions.motion import MotionKind, Operation
from drivers.master.node.node import Node

KEPT = 1000
"""How many ended operations are held in memory."""
PRUNE_EACH = 500
"""Operations after which the store forgets what is too old or too much."""


class OperationRegister:
    """All operations by id, oldest first."""

    def __init__(
        self,
        store: Database,
        axis: Callable[[AxisId], Axis],
        *,
        results: Results = PLAIN,
        kept: int = KEPT,
        keep_days: float = 90,
        keep_number: int = 100_000,
    ) -> None:
        """`axis` finds an axis by its numbers.

        `keep_days` and `keep_number` bound what the store remembers of what ended.
        """
        self._store = store
        self._axis = axis
        self._results = results
        self._kept = kept
        self._keep_days = keep_days
        self._keep_number = keep_number
        self._by_id: OrderedDict[str, RegisteredOperation] = OrderedDict()
        self._since_pruning = PRUNE_EACH
        self.started: dict[MotionKind, int] = dict.fromkeys(MotionKind, 0)
        """How many of each kind were ever started."""
        store.on_return.append(self._write_anew)

    # --- beginning ---

    async def start(
        self,
        kind: MotionKind,
        axes: Sequence[Axis],
        request: Mapping[str, Any],
        begin: Callable[[str], Operation],
        *,
        node: Node | None = None,
        asked_by: Asker = NOBODY,
        claim: Claim | None = None,
    ) -> RegisteredOperation:
        """Write the operation down, then begin it: `begin` is given its id and may refuse by raising.

        The Idempotency-Key that it came with (`claim`) is written down in the same transaction.

        Should the service die in between, it is found as failed, and nothing was sent twice. A store that is
        off holds nothing up. `node` is what it is about where it is about no axis.
        """
        operation_id = uuid.uuid4().hex
        where = axes[0].node.node_id if len(axes) == 1 else None if node is None else node.node_id
        asked = asked_for(operation_id, kind, axes, where, request, asked_by, datetime.now(UTC))
        key = None if claim is None else claim.key
        spent = () if claim is None else claim.spend()
        try:
            await self._store.commit(*spent, records.written(asked, key))
            begun = begin(operation_id)
        except BaseException:
            self._store.later(records.removed(operation_id))
            raise
        return self.add(begun, request, asked_by=asked_by, key=key)

    def add(
        self,
        motion: Operation,
        request: Mapping[str, Any],
        *,
        asked_by: Asker = NOBODY,
        key: str | None = None,
    ) -> RegisteredOperation:
        """Remember what was just begun, and forget the oldest that ended."""
        operation = RegisteredOperation(motion, self._axes(motion), request, asked_by, key, self._results)
        self._by_id[operation.id] = operation
        self.started[motion.kind] += 1
        motion.watch(lambda _: self._write(operation))
        self._write(operation)
        if len(self._by_id) > self._kept:
            ended = next((o.id for o in self._by_id.values() if o.motion.done), None)
            if ended is not None:
                del self._by_id[ended]
        self._prune_sometimes()
        return operation

    # --- looking ---

    def live(self, operation_id: str) -> RegisteredOperation | None:
        """The operation of that id, if this run of the service began it and still holds it."""
        return self._by_id.get(operation_id)

    async def get(self, operation_id: str) -> OperationReply:
        """The operation of that id. Raises `ApiError` (404)."""
        operation = self._by_id.get(operation_id)
        if operation is not None:
            return operation.reply()
        try:
            found = await records.find(self._store, operation_id)
        except StoreOff as off:
            raise ApiError("history_off", f"What ended longer ago can't be read: {off}") from off
        if found is None:
            raise ApiError("unknown_operation", f"There is no operation {operation_id[:64]!r}.")
        return found

    def reply_for(self, motion: Operation) -> OperationReply:
        """What the wire shows of an operation, whoever began it."""
        known = self._by_id.get(motion.id)
        if known is None:
            known = RegisteredOperation(motion, self._axes(motion), {}, results=self._results)
        return known.reply()

    def _axes(self, motion: Operation) -> tuple[Axis, ...]:
        return tuple(self._axis(each) for each in motion.axes)

    def running(self) -> list[RegisteredOperation]:
        """What has not ended."""
        return [operation for operation in self._by_id.values() if not operation.motion.done]

    async def newest(
        self, limit: int, *, state: OperationState | None = None, before: str | None = None
    ) -> list[OperationReply]:
        """The newest first: from the store, and what runs as it is now. From memory while the store is off.

        `before`: only those that were created before that operation. Raises `ApiError` (404) for an unknown
        one.
        """
        if before is not None:
            await self.get(before)
        try:
            wanted = None if state is None else state.value
            found = await records.newest(self._store, limit, state=wanted, before=before)
        except StoreOff:
            return self._newest_here(limit, state, before)
        return [self._by_id[reply.id].reply() if reply.id in self._by_id else reply for reply in found]

    def _newest_here(
        self, limit: int, state: OperationState | None, before: str | None
    ) -> list[OperationReply]:
        replies = [operation.reply() for operation in reversed(self._by_id.values())]
        if before is not None:
            ids = [reply.id for reply in replies]
            replies = replies[ids.index(before) + 1 :] if before in ids else []
        return [reply for reply in replies if state is None or reply.state is state][:limit]

    # --- after a restart ---

    async def take_over(self) -> list[OperationReply]:
        """What ran when the service died has failed; returns it, so that what is found can be noted."""
        try:
            unended = await records.unended(self._store)
        except StoreOff:
            return []
        failed: list[OperationReply] = []
        for reply, key in unended:
            error = problems.problem(
                "service_restarted",
                "The service ended while this operation ran; whether its target was reached is not known.",
                node=reply.node,
                axis=reply.axis,
            )
            ended = reply.model_copy(
                update={
                    "state": OperationState.FAILED,
                    "error": Problem.model_validate(error.body),
                    "reason": error.body["detail"],
                    "ended": datetime.now(UTC),
                }
            )
            failed.append(ended)
            await self._store.commit(records.written(ended, key))
        return failed

    async def note_found(self, operation_id: str, axis: Axis) -> None:
        """An axis of an operation that a restart ended was found again."""
        try:
            known = await records.find(self._store, operation_id)
        except StoreOff:
            return
        if known is not None:
            (key,) = (await self._store.rows("SELECT key FROM operations WHERE id = ?", operation_id))[0]
            told = evidence.with_found(known.evidence, axis, datetime.now(UTC))
            self._store.later(records.written(known.model_copy(update={"evidence": told}), key))

    # --- writing ---

    def _write(self, operation: RegisteredOperation) -> None:
        self._store.later(records.written(operation.reply(), operation.key))

    def _write_anew(self) -> None:
        """The store works again: what it missed is written as far as it is still held here."""
        for operation in self._by_id.values():
            self._write(operation)

    def prune(self) -> None:
        """Have the store forget what is too old or too much."""
        self._since_pruning = 0
        self._store.later(*records.pruned(time.time() - self._keep_days * 86_400, self._keep_number))

    def _prune_sometimes(self) -> None:
        self._since_pruning += 1
        if self._since_pruning >= PRUNE_EACH:
            self.prune()
