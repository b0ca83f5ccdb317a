"""The stop for everything as the wire shows it."""

from __future__ import annotations

from app.stop.schemas import AxisStopReply, StopReply, StopState
from drivers.master.seen.stops import StopLatch, StopReport


def stop(latch: StopLatch | None) -> StopState:
    """Whether everything is stopped."""
    if latch is None:
        return StopState(latched=False, reason=None, time=None)
    return StopState(latched=True, reason=latch.reason, time=latch.time)


def stop_report(report: StopReport) -> StopReply:
    """What a stop for everything found."""
    return StopReply(
        latched=True,
        reason=report.latch.reason,
        time=report.latch.time,
        complete=report.complete,
        axes=[
            AxisStopReply(node=a.node, axis=a.axis, outcome=a.outcome.value, message=a.message)
            for a in report.axes
        ],
    )
