"""Leases."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LeaseGranted:
    """A lease that was just taken, with the token of its holder."""

    id: str
    token: str
    fencing: int
    """Higher than that of every lease before."""
    owner: str


@dataclass(frozen=True, slots=True)
class Lease:
    """A lease as everybody may see it."""

    id: str
    owner: str
    expires_in_s: float
