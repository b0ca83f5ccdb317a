"""What a client asks of an axis: immutable, in steps, checked against 32 bits when made."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import BadValue
from drivers.master.config import HIGHEST_RATE, INT32_MAX, INT32_MIN


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
    """Turn at a velocity in profile velocity mode; 0 ramps down to standstill."""

    velocity: int
    """steps/s, signed"""
    acceleration: int | None = None
    """steps/s2; ramps up and down (manual §1.5)"""

    def __post_init__(self) -> None:
        check_velocity(self.velocity)
        _check_rate("acceleration", self.acceleration)


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
    """Deadline; None: `Timing.homing`."""

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
