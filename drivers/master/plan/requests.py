"""What a client asks of an axis: immutable, in steps, checked against 32 bits when made."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from drivers.errors import BadValue
from drivers.master.plan.configuration import HIGHEST_RATE, INT32_MAX, INT32_MIN

LONGEST_TURNING = 86_400.0
"""Seconds that a velocity may be asked for."""


class OnBusy(enum.StrEnum):
    """What becomes of a command for an axis that something else holds."""

    REJECT = "reject"
    """It is refused."""
    REPLACE = "replace"
    """What runs and what waits is cancelled; the command begins once the axis stands."""
    QUEUE = "queue"
    """It waits, and begins once everything before it has succeeded."""


def _check_rate(name: str, value: int | None) -> None:
    if value is not None and not 1 <= value <= HIGHEST_RATE:
        raise BadValue(f"{name} must be 1..{HIGHEST_RATE} steps, not {value}.", hint=f"Give another {name}.")


def check_velocity(velocity: int) -> None:
    """Raises `BadValue` for a velocity (steps/s, signed) that no drive takes."""
    if abs(velocity) > HIGHEST_RATE:
        raise BadValue(
            f"velocity must be within +-{HIGHEST_RATE} steps/s, not {velocity}.",
            hint="Give a lower velocity.",
        )


@dataclass(frozen=True, slots=True)
class MoveRequest:
    """Go to a position in profile position mode. What is None comes from the axis's configuration."""

    target: int
    """Steps: the position, or the distance from where the axis stands if `relative`."""
    relative: bool = False
    velocity: int | None = None
    """steps/s"""
    acceleration: int | None = None
    """steps/s2"""
    deceleration: int | None = None
    """steps/s2"""

    def __post_init__(self) -> None:
        if not INT32_MIN <= self.target <= INT32_MAX:
            raise BadValue(
                f"A target of {self.target} steps is beyond {INT32_MIN}..{INT32_MAX}.",
                hint=f"Give a target from {INT32_MIN} to {INT32_MAX} steps (607Ah has 32 bits).",
            )
        _check_rate("velocity", self.velocity)
        _check_rate("acceleration", self.acceleration)
        _check_rate("deceleration", self.deceleration)


@dataclass(frozen=True, slots=True)
class VelocityRequest:
    """Turn at a velocity, until something else is commanded or to an end of its own; 0 ramps down to
    standstill. At most one of the three ends may be given, and none with a velocity of 0.
    """

    velocity: int
    """steps/s, signed"""
    acceleration: int | None = None
    """steps/s2; ramps up and down (manual §1.5)"""
    duration_s: float | None = None
    """Turns that long at its velocity, then ramps down; above 0, at most `LONGEST_TURNING`."""
    travel: int | None = None
    """Steps, at least 1, from standstill to standstill; the module itself ends it (profile position mode)."""
    held: bool = False
    """It lasts until the axis is stopped: it never succeeds by itself, and its operation lives as long."""

    def __post_init__(self) -> None:
        check_velocity(self.velocity)
        _check_rate("acceleration", self.acceleration)
        ends = sum((self.duration_s is not None, self.travel is not None, self.held))
        if ends > 1 or (ends and not self.velocity):
            raise BadValue(
                "A velocity has at most one end, and a velocity of 0 has none.",
                hint="Give one of a duration, a travel and a lease, or none of them.",
            )
        if self.duration_s is not None and not 0 < self.duration_s <= LONGEST_TURNING:
            raise BadValue(
                f"A duration must be above 0 and at most {LONGEST_TURNING:g} s.",
                hint="Give another duration.",
            )
        if self.travel is not None and not 1 <= self.travel <= INT32_MAX:
            raise BadValue(f"A travel must be 1..{INT32_MAX} steps.", hint="Give another travel.")

    @property
    def endless(self) -> bool:
        """Whether it turns until something else is commanded, so that nothing can come after it."""
        return bool(self.velocity) and self.duration_s is None and self.travel is None

    @property
    def plain(self) -> bool:
        """Whether it has no end: once the axis has its velocity, the command is done."""
        return self.duration_s is None and self.travel is None and not self.held

    @property
    def as_move(self) -> MoveRequest | None:
        """The move that turns by `travel`; None: it has no such end."""
        if self.travel is None:
            return None
        rate = self.acceleration
        way = self.travel if self.velocity > 0 else -self.travel
        return MoveRequest(
            way, relative=True, velocity=abs(self.velocity), acceleration=rate, deceleration=rate
        )


@dataclass(frozen=True, slots=True)
class HomeRequest:
    """Find the reference in homing mode. What is None comes from the axis's configuration."""

    method: int | None = None
    """6098h"""
    fast: int | None = None
    """6099h:1, steps/s"""
    slow: int | None = None
    """6099h:2, steps/s"""
    acceleration: int | None = None
    """609Ah, steps/s2"""
    timeout_s: float | None = None
    """Deadline; None: from what `predict_home` says."""

    def __post_init__(self) -> None:
        _check_rate("fast", self.fast)
        _check_rate("slow", self.slow)
        _check_rate("acceleration", self.acceleration)
        if self.timeout_s is not None and not 0 < self.timeout_s <= 3600:
            raise BadValue("timeout_s must be above 0 and at most 3600.", hint="Give another timeout_s.")


@dataclass(frozen=True, slots=True)
class SetPositionRequest:
    """Say where the standing axis is; nothing moves."""

    position: int
    """Steps"""
    shift_limits: bool = False
    """Whether that may move the travel limits of an axis that was homed."""

    def __post_init__(self) -> None:
        if not INT32_MIN < self.position <= INT32_MAX:
            raise BadValue(
                f"A position of {self.position} steps is beyond {INT32_MIN + 1}..{INT32_MAX}.",
                hint=f"Give a position from {INT32_MIN + 1} to {INT32_MAX} steps (607Ch has 32 bits).",
            )


@dataclass(frozen=True, slots=True)
class JogRequest:
    """Turn while it is held; `velocity` is that of the first hold."""

    velocity: int
    """steps/s, signed"""
    acceleration: int | None = None
    """steps/s2; ramps up and down (manual §1.5)"""
    silence_s: float = 0.5
    """Seconds for which a hold counts; 0.1 to 2."""

    def __post_init__(self) -> None:
        check_velocity(self.velocity)
        _check_rate("acceleration", self.acceleration)
        if not 0.1 <= self.silence_s <= 2:
            raise BadValue("silence_s must be 0.1 to 2 seconds.", hint="Give another silence_s.")


Request = MoveRequest | VelocityRequest | HomeRequest | SetPositionRequest | JogRequest
