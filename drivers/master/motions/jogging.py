"""Jogging: an axis turns in profile velocity mode while somebody holds it, and not a moment longer.

The dead man is here, beside the axis, on the event loop's own clock: a hold counts for a while, and when none
has come for that long the halt goes out from a timer, whatever became of who held. Profile velocity mode
knows no target that 607Dh could check (manual §7.1.8), so the speed towards a software limit is bounded to
what can still be braked: the axis comes to rest within its limits, at the latest at one.
"""

from __future__ import annotations

import asyncio
import contextlib
import enum
import math
import statistics
from collections import deque
from collections.abc import Awaitable, Callable

from drivers.cia402.power import Controlword
from drivers.errors import BadValue, BusError, CanaxisError, MotionFailed
from drivers.master.drive import stopping
from drivers.master.drive.tools import AxisTools
from drivers.master.motions import profile_velocity
from drivers.master.motions.motion import Motion, MotionKind, MotionState, Operation, Result
from drivers.master.plan.configuration import INT32_MAX, INT32_MIN
from drivers.master.plan.requests import JogRequest
from drivers.master.seen.status import AxisStatus
from drivers.master.seen.watch import Watchdog

_POLL = 0.02
"""Seconds after which the speed is bounded anew although no status came."""
_ROUND_TRIPS = 1000
"""How many round trips are kept for their median."""


class JogEnd(enum.StrEnum):
    """Why a jog came to its end, where nobody else ended it."""

    RELEASED = "released"
    SILENCE = "silence"
    """No hold came in time."""
    CLOSED = "closed"
    """Whoever held is gone."""
    LEASE = "lease"
    """Whoever held has lost the axis to somebody else."""
    LIMIT = "limit"
    """The axis is at a software limit."""


_REASONS = {
    JogEnd.SILENCE: "No hold came in time.",
    JogEnd.CLOSED: "The connection that held it was closed.",
    JogEnd.LEASE: "The lease under which it was held has ended.",
}
"""The ends that nobody wanted."""


def safe_speed(room: float, rate: float, reaction: float) -> float:
    """The highest speed (steps/s) from which an axis stands within `room` steps, ramping down with `rate`
    (steps/s2) from `reaction` seconds on: v t + v^2 / 2a = room. 0 where there is no room.

    An axis that follows it as `room` shrinks never has to brake harder than with `rate`.
    """
    if room <= 0:
        return 0.0
    return rate * (math.sqrt(reaction * reaction + 2.0 * room / rate) - reaction)


def check_room(tools: AxisTools, velocity: int) -> None:
    """Refuse to jog further where there is no room. Raises `BadValue`."""
    room = _room(tools, tools.drive.status.position or 0, velocity)
    if velocity and room is not None and room <= 0:
        low, high = tools.config.target_range
        raise BadValue(
            f"Axis {tools.config.name} is at {tools.drive.status.position}; its limits are {low}..{high} "
            "steps.",
            hint="Jog the other way.",
            **tools.where,
        )


class Jog(Motion):
    """One press: from the first hold to standstill."""

    def __init__(
        self,
        tools: AxisTools,
        request: JogRequest,
        held_at: float,
        on_change: Callable[[Operation], None],
        stop: Callable[[Motion, str], Awaitable[None]],
        operation_id: str | None = None,
    ) -> None:
        """`held_at`: loop time of the hold that began it; the dead man counts from there."""
        super().__init__(MotionKind.JOG, tools, request, on_change, stop, operation_id)
        self.acceleration = request.acceleration or tools.config.acceleration
        self.velocity = request.velocity
        """What the last hold asked for, steps/s."""
        self.over: JogEnd | None = None
        """Why it comes to rest, or did; None while it is held, or if somebody else ended it."""
        self.longest_gap = 0.0
        """Seconds, between two holds."""
        self.holds = 1
        self._tools = tools
        self._began_at = tools.drive.status.position
        self._round_trips: deque[float] = deque(maxlen=_ROUND_TRIPS)
        self._longest_round_trip = 0.0
        self._turned_at = math.inf
        self._standing_since: float | None = None
        self._dead_man = Watchdog(request.silence_s, 0.0, lambda: self.end(JogEnd.SILENCE))
        self._held_at = held_at
        self._dead_man.feed(held_at)

    @property
    def held(self) -> bool:
        """Whether holds still count."""
        return self.over is None and not self.done

    def hold(self, velocity: int, at: float) -> None:
        """Somebody held at loop time `at`, at a velocity in steps/s that may be another; one above the
        axis's maximum counts as that. No news to a jog that is over.
        """
        if not self.held:
            return
        self.holds += 1
        self.longest_gap = max(self.longest_gap, at - self._held_at)
        self._held_at = at
        self._dead_man.feed(at)
        highest = self._tools.config.max_velocity
        self.velocity = max(-highest, min(highest, velocity))
        if self._turned_at < math.inf:
            self._steer(self._tools.drive.status, again=True)

    def note_round_trip(self, seconds: float) -> None:
        """How long the way to whoever holds and back was."""
        self._round_trips.append(seconds)
        self._longest_round_trip = max(self._longest_round_trip, seconds)

    def end(self, why: JogEnd) -> None:
        """Ramp down now: the halt is sent before this returns. Idempotent; the first reason counts."""
        if self.held:
            self.over = why
            self._dead_man.stop()
            stopping.begin(self._tools)

    def succeed(self, result: Result) -> None:
        """It stands. A jog whose end nobody wanted counts as cancelled."""
        if self.over is None or self.over not in _REASONS:
            super().succeed(result)
        else:
            self.give_up(_REASONS[self.over])

    def account(self) -> Result:
        """What came of it so far."""
        position = self._tools.drive.status.position
        told: dict[str, int | float | bool | str] = {
            "position": position or 0,
            "travelled": (position or 0) - (self._began_at or 0),
            "holds": self.holds,
            "longest_gap_ms": round(self.longest_gap * 1000, 1),
        }
        if self.over is not None:
            told["end"] = self.over.value
        if self._round_trips:
            told["round_trip_p50_ms"] = round(statistics.median(self._round_trips) * 1000, 2)
            told["round_trip_max_ms"] = round(self._longest_round_trip * 1000, 2)
        return told

    def _finish(self, state: MotionState, error: CanaxisError | None) -> None:
        if not self.done:
            self._dead_man.stop()
            self.result = self.account()
        super()._finish(state, error)

    # --- for `run` ---

    def turn(self) -> None:
        """The drive is ready: follow the holds."""
        self._turned_at = asyncio.get_running_loop().time()
        self.begin()
        self._steer(self._tools.drive.status, again=True)

    def look(self, status: AxisStatus) -> bool:
        """Whether it is over. Raises if the axis can't go on."""
        if not self.held:
            return True
        self._tools.require_enabled(status)
        self._steer(status, again=False)
        self._check_stuck(status)
        return not self.held

    def _steer(self, status: AxisStatus, *, again: bool) -> None:
        """Command what the last hold asked for, as far as the limits allow; `again`: even if it is known."""
        velocity = self._bounded(status)
        if velocity is None:
            self.end(JogEnd.LIMIT)
        elif again or velocity != self._tools.drive.target:
            with contextlib.suppress(BusError):  # the next hold says it again
                self._tools.drive.command_velocity(Controlword.ENABLE_OPERATION, velocity)

    def _bounded(self, status: AxisStatus) -> int | None:
        """The velocity within what can be braked; None at the limit."""
        tools, wanted = self._tools, self.velocity
        room = _room(tools, status.position or 0, wanted)
        if room is None:
            return wanted
        direction = 1 if wanted > 0 else -1
        drive, timing = tools.drive, tools.timing
        now = asyncio.get_running_loop().time()
        age = max(0.0, now - (now if drive.motion_at is None else drive.motion_at))
        seen = max(0, (status.velocity or 0) * direction)  # it may have got faster since then
        gained = self.acceleration * min(age, now - self._turned_at)
        fastest = max(seen, min(drive.target * direction, seen + gained))
        reaction = _POLL + timing.position_inhibit + timing.flight + timing.loop_grace
        allowed = safe_speed(room - fastest * age, self.acceleration, reaction)
        if allowed < max(1, tools.config.end_velocity):
            return None
        return direction * min(abs(wanted), int(allowed))

    def _check_stuck(self, status: AxisStatus) -> None:
        now = asyncio.get_running_loop().time()
        if status.moving or not self._tools.drive.target or self._standing_since is None:
            self._standing_since = now
        elif now - self._standing_since > self._tools.timing.stuck:
            raise MotionFailed(
                f"Axis {self._tools.config.name} stands still though it is held at {self.velocity} steps/s.",
                hint="Look for a limit switch, an obstacle or too low a current.",
                **self._tools.where,
            )


async def run(tools: AxisTools, jog: Jog) -> Result:
    """Follow the holds to their end, then come to rest; returns at standstill, in mode 0."""
    await profile_velocity.enter(tools, jog.acceleration)
    if jog.held:
        jog.turn()
    while not await tools.drive.until(jog.look, _POLL):
        pass
    await stopping.come_to_rest(tools)
    await tools.drive.fresh_motion()
    return jog.account()


def _room(tools: AxisTools, position: int, velocity: int) -> int | None:
    """Steps to the software limit in the direction of a velocity; None where none is set there."""
    low, high = tools.config.target_range
    if velocity > 0:
        return None if high == INT32_MAX else high - position
    return None if low == INT32_MIN or not velocity else position - low
