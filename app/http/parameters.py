"""What many routes take besides a path and a body of their own: headers, `dry_run`, an empty body."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Query

from app.http.schemas import NoBody

LEASE = "lease"
"""The header with the token of a lease."""
KEY = "idempotency-key"
"""The header with an idempotency key."""
IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=255,
        description=(
            "Any text of your own, new with each new command. A command that is sent again with the same "
            "key, path, query and body is not carried out again: it gets the first answer again, with "
            "`Idempotent-Replayed: true`. With anything else it gets 422, and while the first is in flight "
            "409. A command that was refused (4xx, 503) leaves its key free. Keys are kept for 24 hours, "
            "over restarts of the service too, and each token has keys of its own."
        ),
    ),
]
LeaseToken = Annotated[
    str | None,
    Header(
        alias="Lease",
        max_length=255,
        description=(
            "The token of the lease under which it is sent. Without it, an axis of a lease takes no command: "
            "423 `leased`. With one that expired, was released or taken over: 423 `lease_lost`, even if the "
            "axis is free."
        ),
    ),
]


async def empty_body(body: NoBody | None = None) -> None:
    """Documents that a command without parameters takes an empty object: so clients send its content type."""
    del body


DryRun = Annotated[
    bool,
    Query(
        description="Only say what the command would come to: nothing is sent, no operation is made, no "
        "Idempotency-Key is spent, no lease is needed. A disabled axis will do.",
    ),
]
