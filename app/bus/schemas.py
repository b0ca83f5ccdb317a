"""The bus on the wire."""

from __future__ import annotations

from pydantic import Field

from app.http import examples
from app.http.schemas import Reply

_BUS: examples.Example = {
    "name": "socketcan:can0",
    "state": "active",
    "reason": "",
    "warnings": [],
    "counters": {"received": 1200, "sent": 300},
}


class BusReply(Reply):
    """The wire, and what passed over it."""

    model_config = examples.shown(_BUS)

    name: str
    state: str = Field(description="closed, active, warning, passive, bus_off, down")
    reason: str = Field(description="Why it is in this state; empty when all is well.")
    warnings: list[str]
    counters: dict[str, int]
