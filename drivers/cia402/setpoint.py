"""The hand-over of a set point in profile position mode (manual §6.1.1, §6.1.2, §6.2).

The drive takes the target on the 0-to-1 edge of controlword bit 4, and statusword bit 12 is 1 while the set
point is in process, 0 when it is processed. Two things are unverified on hardware, and both are allowed
for: whether "in process" means until the set point is taken (as in CiA 402) or until the motion has ended,
and whether a drive may be so fast that no statusword ever shows the 1. So bit 4 is lowered on the first
evidence that the set point was taken, or without any when a bounded time has passed.
"""

from __future__ import annotations

import enum
from typing import Final

from drivers.cia402.power import Controlword, PowerState, Statusword, decode_state, holding_controlword


class SetPointStep(enum.Enum):
    """What the owner of the handshake does next."""

    WAIT = "wait"
    """Nothing."""
    RELEASE = "release"
    """Write `release_controlword`, which has bit 4 low. Given once."""
    DONE = "done"
    """Nothing any more: bit 4 is low and the set point processed. Look at `evidence`."""
    LOST = "lost"
    """The drive left OPERATION_ENABLED. Write `release_controlword`, which keeps it where it is."""


class Evidence(enum.IntEnum):
    """Why the set point is believed to be taken, weakest first."""

    NONE = 0
    """Time alone. The frame may have been lost, and a "target reached" may be the previous target's: compare
    the position with the target before calling the motion a success."""
    TARGET_LEFT = 1
    """Bit 10 (target reached) fell."""
    MOTION = 2
    """Bit 14 (motor activity) rose."""
    ACKNOWLEDGED = 3
    """Bit 12 rose."""


class _Phase(enum.Enum):
    IDLE = enum.auto()
    RAISED = enum.auto()
    LOWERED = enum.auto()


class SetPointHandshake:
    """One hand-over after the other; `start` begins the next and forgets what came before.

    Feed every statusword that comes, and call `on_time` at `deadline`. `now` is seconds on any one
    monotonic clock. `grace_s` bounds the time in which bit 4 is high: it must be longer than a statusword
    can be old (TPDO inhibit time or SYNC period, plus the bus) and a controlword take to arrive, else
    evidence is missed.

    DONE may come only at the end of the motion, if that is what the drive means by "in process": bound the
    wait for it by the motion's time, not by the hand-over's.
    """

    def __init__(self, grace_s: float) -> None:
        if not grace_s > 0:
            raise ValueError(f"a grace of {grace_s} s leaves no time for an answer")
        self._grace_s: Final = grace_s
        self._phase = _Phase.IDLE
        self._previous = 0
        self._deadline: float | None = None
        self._evidence = Evidence.NONE
        self._state = PowerState.OPERATION_ENABLED
        self._end = SetPointStep.DONE

    @property
    def bit4_high(self) -> bool:
        """Whether the controlword with bit 4 was given out and the one without it not yet."""
        return self._phase is _Phase.RAISED

    @property
    def evidence(self) -> Evidence:
        """The strongest evidence seen since `start`."""
        return self._evidence

    @property
    def deadline(self) -> float | None:
        """When `on_time` is due; None while nothing depends on time."""
        return self._deadline

    @property
    def release_controlword(self) -> int:
        """The controlword that lowers bit 4 and keeps the drive in the state that was last seen."""
        return holding_controlword(self._state)

    def start(self, statusword: int, now: float, *, relative: bool = False) -> int:
        """The controlword that hands the target in 607Ah over.

        `statusword` is the last one from before: bits that it has already are no evidence. The drive is in
        OPERATION_ENABLED and its bit 4 low, or there is no edge.
        """
        self._phase = _Phase.RAISED
        self._previous = statusword
        self._deadline = now + self._grace_s
        self._evidence = Evidence.NONE
        self._state = PowerState.OPERATION_ENABLED
        self._end = SetPointStep.DONE
        return (
            Controlword.ENABLE_OPERATION
            | Controlword.NEW_SET_POINT
            | (Controlword.RELATIVE if relative else 0)
        )

    def feed(self, statusword: int, now: float) -> SetPointStep:
        """Take a statusword that came after `start`."""
        if self._phase is _Phase.IDLE:
            return self._end
        self._evidence = max(self._evidence, self._evidence_in(statusword))
        self._previous = statusword
        state = decode_state(statusword)
        # What codes no state tells nothing, least of all that power may be cut.
        if state not in (None, PowerState.OPERATION_ENABLED):
            return self._lose(state)
        if self._phase is _Phase.RAISED:
            return self._release_if(self._evidence is not Evidence.NONE or self._is_late(now))
        if statusword & Statusword.BIT12:
            return SetPointStep.WAIT
        self._phase = _Phase.IDLE
        return self._end

    def on_time(self, now: float) -> SetPointStep:
        """Lower bit 4 if the grace has passed. Never DONE by time: that takes a statusword."""
        if self._phase is _Phase.IDLE:
            return self._end
        return self._release_if(self._phase is _Phase.RAISED and self._is_late(now))

    def abandon(self) -> int | None:
        """End the hand-over now: the controlword to write, or None if bit 4 is low already."""
        raised = self.bit4_high
        self._phase = _Phase.IDLE
        self._deadline = None
        return self.release_controlword if raised else None

    def _evidence_in(self, statusword: int) -> Evidence:
        rose = statusword & ~self._previous
        fell = self._previous & ~statusword
        if rose & Statusword.BIT12:
            return Evidence.ACKNOWLEDGED
        if rose & Statusword.MOTOR_ACTIVITY:
            return Evidence.MOTION
        if fell & Statusword.TARGET_REACHED:
            return Evidence.TARGET_LEFT
        return Evidence.NONE

    def _is_late(self, now: float) -> bool:
        return self._deadline is not None and now >= self._deadline

    def _release_if(self, due: bool) -> SetPointStep:
        if not due:
            return SetPointStep.WAIT
        self._phase = _Phase.LOWERED
        self._deadline = None
        return SetPointStep.RELEASE

    def _lose(self, state: PowerState) -> SetPointStep:
        self._phase = _Phase.IDLE
        self._deadline = None
        self._state = state
        self._end = SetPointStep.LOST
        return self._end
