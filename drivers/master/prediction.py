"""How long a motion will take and how fast it will get: for deadlines, for looking before moving.

The numbers follow the module's ramps (manual §1.5) from what the axis is configured with and what the request
says. What the load does to them is not known here: a deadline adds `Timing.motion_factor` and margins.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.devices.ramp import Ramp, bands, plan_move, plan_stop, plan_velocity
from drivers.devices.trajectory import Trajectory
from drivers.master.config import AxisConfig


@dataclass(frozen=True, slots=True)
class Prediction:
    """A motion that was not commanded yet."""

    duration_s: float
    """From the first step to standstill, or to the velocity that was asked for."""
    peak_velocity: float
    """steps/s, without direction."""
    start: int
    """steps"""
    end: int
    """Where it will stand, or where it will be when it has its velocity; steps."""


def predict_move(
    config: AxisConfig,
    start: int,
    target: int,
    *,
    velocity: int | None = None,
    acceleration: int | None = None,
    deceleration: int | None = None,
) -> Prediction:
    """A move in profile position mode from standstill. Rates in steps/s and steps/s2; None: as configured."""
    v1, v2 = config.ramp_v1, config.ramp_v2
    ramp = Ramp(
        config.start_velocity,
        config.end_velocity,
        velocity or config.velocity,
        bands(v1, v2, config.ramp_a1, config.ramp_a2, acceleration or config.acceleration),
        bands(v1, v2, config.d1, config.d2, deceleration or config.deceleration),
    )
    return _prediction(plan_move(0.0, start, 0.0, target, ramp), start, target)


def predict_velocity(
    config: AxisConfig, position: int, present: int, velocity: int, *, acceleration: int | None = None
) -> Prediction:
    """The ramp in profile velocity mode from the present velocity to another, through 0 if it must."""
    rate = acceleration or config.acceleration
    first, origin, duration, peak = present, float(position), 0.0, abs(present)
    if present * velocity < 0 or not velocity:
        down = plan_stop(0.0, origin, present, rate, config.end_velocity)
        first, origin, duration = 0, down.end, down.duration
    if velocity:
        up = plan_velocity(0.0, origin, first, velocity, rate, config.start_velocity, config.end_velocity)
        origin, duration, peak = up.end, duration + up.duration, max(peak, abs(velocity))
    return Prediction(duration, peak, position, round(origin))


def predict_stop(velocity: int, rate: int, end_velocity: int = 0) -> float:
    """Seconds from a velocity (steps/s) to standstill."""
    return plan_stop(0.0, 0.0, velocity, rate, end_velocity).duration


def _prediction(way: Trajectory, start: int, end: int) -> Prediction:
    return Prediction(way.duration, way.peak_speed, start, end)
