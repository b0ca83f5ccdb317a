"""The bus as the wire shows it."""

from __future__ import annotations

import dataclasses

from app.bus.opening import BusOpener
from app.bus.schemas import BusReply


def bus(opener: BusOpener) -> BusReply:
    """The wire as it is now."""
    status = opener.network.bus_status()
    return BusReply(
        name=status.name,
        state=status.state.value,
        reason=opener.problem or status.reason,
        warnings=list(status.warnings),
        counters=dataclasses.asdict(status.counters),
    )
