"""What is counted rather than raised: odd frames and late answers.

Each has one writer; readers take copies.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class SdoCounters:
    """One node's SDO channel."""

    requests: int = 0
    """Transfers begun."""
    completed: int = 0
    aborted_by_node: int = 0
    timeouts: int = 0
    cancelled: int = 0
    """Transfers whose callers all gave up; we sent an abort."""
    shared: int = 0
    """Reads that joined another's transfer."""
    refused: int = 0
    """Transfers that found no room in the queue, or were driven out of it by a more urgent one."""
    violations: int = 0
    """Answers that broke the protocol; we aborted the transfer."""
    late: int = 0
    """Answers that nobody awaited: late, doubled, or from a second node. Dropped."""
    foreign: int = 0
    """Answers to something else than was asked. Dropped."""
    malformed: int = 0
    """Answers that were not eight bytes long. Dropped."""


@dataclass(slots=True)
class NodeCounters:
    """One node."""

    sdo: SdoCounters = field(default_factory=SdoCounters)
    heartbeats: int = 0
    boot_ups: int = 0
    malformed_heartbeats: int = 0
    foreign_requests: int = 0
    """SDO requests of another master to this node. Their answers are among the foreign and late ones."""
    pdos: int = 0
    short_pdos: int = 0
    """TPDOs with fewer bytes than are mapped, or more. Dropped."""
    emergencies: int = 0
    malformed_emergencies: int = 0
    losses: int = 0
    """Times that the node was lost."""


@dataclass(slots=True)
class NetworkCounters:
    """The whole bus."""

    received: int = 0
    sent: int = 0
    send_failures: int = 0
    """Frames that the bus would not take."""
    error_frames: int = 0
    extended_frames: int = 0
    remote_frames: int = 0
    unrouted: int = 0
    """Frames whose identifier is nobody's here."""
    late_heartbeats: int = 0
    """Periods of our own heartbeat that the event loop missed."""
