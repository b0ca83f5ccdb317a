"""Leases on the wire."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from app.http import examples
from app.http.schemas import Reply, Request
from app.leases.book import DEFAULT_TTL, LONGEST, SHORTEST

Ttl = Annotated[float, Field(ge=SHORTEST, le=LONGEST)]


def _reference(value: object) -> int | str:
    if isinstance(value, bool) or not isinstance(value, int | str) or not 0 < len(str(value)) <= 64:
        raise PydanticCustomError("reference", "must be a number, or a name of 1 to 64 characters")
    return value


Reference = Annotated[
    int | str, BeforeValidator(_reference), Field(description="ID or number, or the name.", examples=["x"])
]


class AxisReference(Request):
    """An axis by what paths call it."""

    node: Reference
    axis: Reference


_LEASE_BODY: examples.Example = {
    "axes": [{"node": "stage", "axis": "x"}, {"node": "stage", "axis": "y"}],
    "ttl_s": 10,
    "owner": "scheduler 1",
}


class LeaseBody(Request):
    """Take exclusive control of some axes, or of every axis of a node: one of the two is given."""

    model_config = examples.shown(_LEASE_BODY)

    axes: list[AxisReference] | None = Field(default=None, min_length=1, max_length=128)
    node: Reference | None = None
    ttl_s: Ttl = Field(default=DEFAULT_TTL, description="Seconds until it expires unless it is renewed.")
    owner: str | None = Field(
        default=None,
        min_length=1,
        max_length=80,
        description="What others are told of who has it; the name of the token if it is left out.",
    )
    force: bool = Field(
        default=False, description="End the leases that are in the way; their axes are stopped. Audited."
    )


class RenewBody(Request):
    """Let a lease last from now on."""

    model_config = examples.shown({"ttl_s": 10})

    ttl_s: Ttl | None = Field(default=None, description="Seconds; what it was taken with if left out.")


class ReleaseBody(Request):
    """Give a lease back."""

    model_config = examples.shown({"stop": False})

    stop: bool = Field(default=False, description="Whether to stop what runs on its axes.")


class LeaseAxis(Reply):
    """An axis of a lease."""

    node: int
    axis: int
    name: str


class LeaseLinks(Reply):
    """Where to go from here."""

    self: str
    renew: str
    release: str


_LEASE: examples.Example = {
    "id": "0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11",
    "fencing": 1767268800000,
    "owner": "scheduler 1",
    "axes": [{"node": 1, "axis": 0, "name": "x"}, {"node": 1, "axis": 1, "name": "y"}],
    "ttl_s": 10.0,
    "created": examples.TIME,
    "expires": "2026-01-01T12:00:10Z",
    "expires_in_s": 10.0,
    "links": {
        "self": "/api/v1/leases/0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11",
        "renew": "/api/v1/leases/0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11/renew",
        "release": "/api/v1/leases/0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11/release",
    },
}


class LeaseReply(Reply):
    """Exclusive control of some axes."""

    model_config = examples.shown(_LEASE)

    id: str
    fencing: int = Field(description="Higher than that of every lease before, over restarts too.")
    owner: str
    axes: list[LeaseAxis]
    ttl_s: float = Field(description="Seconds that it lasts without being renewed.")
    created: datetime
    expires: datetime
    expires_in_s: float = Field(description="Seconds; what counts, whatever the clocks say.")
    links: LeaseLinks


class LeaseGranted(LeaseReply):
    """A lease that was just taken, for its holder."""

    model_config = examples.shown({**_LEASE, "token": "mI3o5f9bqz2l5c1xT7v0a8Kd4nWuYs6E"})

    token: str = Field(description="For the header `Lease` of every command. Shown this once.")


class LeaseList(Reply):
    """Every lease, the oldest first."""

    model_config = examples.shown({"leases": [_LEASE]})

    leases: list[LeaseReply]
