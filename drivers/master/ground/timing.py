"""Every time that the master waits, in one place. All in seconds on the event loop's monotonic clock."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Timing:
    """The bounds of everything that could otherwise wait for ever."""

    sdo_response: float = 0.3
    """How long one SDO answer may take, counted anew for each request frame of a segmented transfer."""
    sdo_queue: float = 5.0
    """How long a transfer may wait for its turn in the node's queue; nothing was sent if that runs out."""
    sdo_transfer: float = 30.0
    """How long a caller waits in all, turn and segments included, if it gives no deadline of its own."""
    sdo_quarantine: float = 0.25
    """How late an answer may come once `sdo_response` is over; until then the channel stays silent after a
    transfer that was given up.
    """

    probe_first: float = 0.5
    """Pause after the first unanswered probe of an absent node; doubles up to `probe_last`."""
    probe_last: float = 5.0
    """Longest pause between two probes of an absent node."""
    refused_retry: float = 30.0
    """Pause before a node that was refused is identified anew (it is at once after a boot-up)."""
    nmt_change: float = 1.0
    """How long a node may take to follow an NMT command, beyond the two heartbeats that may say so."""

    heartbeat_stale: float = 1.5
    """In periods of the node's heartbeat: silence after which motion is refused and a stop is tried."""
    heartbeat_lost: float = 3.0
    """In periods of the node's heartbeat: silence after which the node counts as lost."""
    loop_grace: float = 0.02
    """Before a silence counts: the time for frames that a busy event loop has not read yet."""

    pdo_event_timer: float = 0.1
    """Event timer of the status TPDOs: they come at least this often."""
    status_inhibit: float = 0.005
    """Inhibit time of TPDO 1 (statusword, mode, inputs)."""
    position_inhibit: float = 0.01
    """Inhibit time of TPDO 2 (position, velocity)."""
    status_stale: float = 5.0
    """In event timers: silence of a status TPDO after which the status is stale."""

    flight: float = 0.005
    """The longest that a frame may be under way: what comes later than this was sampled after a command."""
    resend: float = 0.15
    """How long an idempotent command (power state, mode, halt) may go without effect before it is sent again.
    """
    transition: float = 3.0
    """How long one CiA 402 transition may take, brake and enable delays included."""
    mode_change: float = 1.0
    """How long 6061h may take to follow 6060h."""
    handshake: float = 1.0
    """How long the drive may take to acknowledge a set point or a homing start."""
    group_start: float = 0.3
    """How long an axis may take to show that it started with a group; then all of the group are stopped."""
    stuck: float = 2.5
    """How long an accepted motion may stand still short of its end before it counts as failed (2015h is <=
    2.1 s).
    """
    motion_factor: float = 1.25
    """A motion's deadline is the computed duration times this ..."""
    motion_margin: float = 3.0
    """... plus this."""
    standstill_margin: float = 2.0
    """A stop's deadline is the computed ramp times `motion_factor` plus this; then quick stop is tried."""
    shutdown: float = 10.0
    """How long closing the network waits, in all, for every axis to stand and be disabled."""
    stop_all: float = 10.0
    """How long a stop for everything waits for its report; the stopping itself goes on."""
