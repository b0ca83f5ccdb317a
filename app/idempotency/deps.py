"""Who sent a command, and under which key: what the routes of commands depend on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from app.access.schemas import Asker
from app.access.tokens import Principal
from app.http.parameters import IdempotencyKey, LeaseToken
from app.idempotency.keys import Claim


@dataclass(frozen=True, slots=True)
class CommandSource:
    """Who sent a command, and under which key."""

    name: str
    address: str
    claim: Claim | None
    """The Idempotency-Key that is to be spent with it."""
    lease: str | None
    """The token of the lease under which it was sent."""

    @property
    def reply(self) -> Asker:
        """As an operation shows it."""
        return Asker(name=self.name, address=self.address)


async def get_asker(
    request: Request, idempotency_key: IdempotencyKey = None, lease: LeaseToken = None
) -> CommandSource:
    """Who asks, as far as the middlewares know."""
    del idempotency_key  # documented here; what counts is the claim
    principal: Principal = request.state.principal
    address = "" if request.client is None else request.client.host
    return CommandSource(principal.name, address, _claim(request), lease)


AskerDep = Annotated[CommandSource, Depends(get_asker)]


def _claim(request: Request) -> Claim | None:
    return getattr(request.state, "claim", None)


async def command_headers(
    request: Request, idempotency_key: IdempotencyKey = None, lease: LeaseToken = None
) -> None:
    """For a command that begins no operation: its key is spent before it is carried out.

    One that begins an operation has its key written down with that (`Starter`), and must not have this.
    """
    del idempotency_key, lease  # documented here; what counts is the claim, and who looks for node or axis
    if (claim := _claim(request)) is not None:
        await claim.write_down()
