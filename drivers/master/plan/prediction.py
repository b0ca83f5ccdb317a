"""How long a motion will take and how fast it will get: for deadlines, for looking before moving.

The numbers follow the module's ramps (manual §1.5) from what the axis is configured with and what the request
says. What the load does to them is not known here: a deadline adds `Timing.motion_factor` and margins.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.cia402.homing import HOMING_METHODS, HomingSignal
from drivers.devices.ramp import Ramp, bands, plan_move, plan_stop, plan_velocity
from drivers.devices.trajectory import Trajectory
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.requests import (
    HomeRequest,
    JogRequest,
    MoveRequest,
    Request,
    SetPositionRequest,
    VelocityRequest,
)

TURN = 51_200
"""Microsteps of a turn as the module comes (2000h, 2001h)."""
SEARCHED_TURNS = 100
"""How far a homing is taken to search on an axis without software limits."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """A motion that was not commanded yet."""

    duration_s: float
    """From the first step to standstill, or to the velocity that was asked for; of a homing the longest."""
    peak_velocity: float
    """steps/s, without direction; of several axes the highest."""
    start: int | None
    """steps; None: behind a homing, where it is not known, or of several axes."""
    end: int | None
    """Where it will stand, or where it will be when it has its velocity; steps. None: a homing finds out, or
    there are several axes.
    """
    path: tuple[int, int] | None = None
    """The lowest and the highest position on the way up to `end`, steps; None: not known."""
    assumed: tuple[str, ...] = ()
    """What was taken for granted, a sentence each."""


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
    places = [position]
    if present * velocity < 0 or not velocity:
        down = plan_stop(0.0, origin, present, rate, config.end_velocity)
        first, origin, duration = 0, down.end, down.duration
        places.append(round(origin))
    if velocity:
        up = plan_velocity(0.0, origin, first, velocity, rate, config.start_velocity, config.end_velocity)
        origin, duration, peak = up.end, duration + up.duration, max(peak, abs(velocity))
    places.append(round(origin))
    return Prediction(duration, peak, position, places[-1], (min(places), max(places)))


def predict_turning(config: AxisConfig, position: int, present: int, request: VelocityRequest) -> Prediction:
    """A velocity with or without an end of its own, from the present position and velocity."""
    if (move := request.as_move) is not None:
        return _predict_move(config, move, position)
    rate = request.acceleration
    up = predict_velocity(config, position, present, request.velocity, acceleration=rate)
    if request.duration_s is None:
        return up
    assert up.end is not None
    assert up.path is not None
    braking = round(up.end + request.velocity * request.duration_s)
    down = predict_velocity(config, braking, request.velocity, 0, acceleration=rate)
    assert down.end is not None
    return Prediction(
        up.duration_s + request.duration_s + down.duration_s,
        up.peak_velocity,
        position,
        down.end,
        (min(up.path[0], down.end), max(up.path[1], down.end)),
    )


def predict_home(config: AxisConfig, request: HomeRequest, start: int | None = None) -> Prediction:
    """The longest that a homing may take, since nobody knows where the switch is (manual §8.1).

    It searches the whole travel with the fast speed, a home switch also back from the other end; then it
    leaves the switch, or looks for the index pulse, with the slow speed.
    """
    number = config.homing_method if request.method is None else request.method
    method = HOMING_METHODS.get(number)
    if method is not None and not method.moves:
        return Prediction(0.0, 0.0, start, 0, None if start is None else (start, start))
    uses = frozenset[HomingSignal]() if method is None else method.uses
    fast, slow = request.fast or config.homing_fast, request.slow or config.homing_slow
    rate = request.acceleration or config.homing_acceleration
    legs = 2 if HomingSignal.HOME_SWITCH in uses else 0 if uses == frozenset((HomingSignal.INDEX,)) else 1
    travel, assumed = _searched(config)
    seeking = legs * (travel / fast + 2 * fast / rate)
    overshoot = fast * fast / (2 * rate) if legs else 0.0
    turn = _turn(config)
    slowly = legs * (overshoot + turn) + (turn if HomingSignal.INDEX in uses else 0)
    said = [assumed, f"A switch is at most {turn} steps wide."] if legs else []
    if HomingSignal.INDEX in uses:
        said.append(f"An index pulse comes each {turn} steps.")
    return Prediction(
        seeking + slowly / slow + slow / rate,
        float(max(fast, slow) if legs else slow),
        start,
        None,
        assumed=tuple(said),
    )


def predict(
    config: AxisConfig,
    request: Request,
    position: int | None,
    velocity: int = 0,
) -> Prediction | None:
    """What a request will come to from a position (steps; None: not known) and, for a velocity, the present
    velocity (steps/s). None: it can't be told without a position.
    """
    if isinstance(request, HomeRequest):
        return predict_home(config, request, position)
    if isinstance(request, SetPositionRequest):
        return Prediction(0.0, 0.0, position, request.position)
    if position is None or isinstance(request, JogRequest):
        return None
    if isinstance(request, VelocityRequest):
        return predict_turning(config, position, velocity, request)
    return _predict_move(config, request, position)


def predict_stop(velocity: int, rate: int, end_velocity: int = 0) -> float:
    """Seconds from a velocity (steps/s) to standstill."""
    return plan_stop(0.0, 0.0, velocity, rate, end_velocity).duration


def predict_rest(position: int, velocity: int, rate: int, end_velocity: int = 0) -> int:
    """Where an axis stands after a stop from a velocity (steps/s)."""
    return round(plan_stop(0.0, float(position), velocity, rate, end_velocity).end)


def _predict_move(config: AxisConfig, request: MoveRequest, position: int) -> Prediction:
    return predict_move(
        config,
        position,
        position + request.target if request.relative else request.target,
        velocity=request.velocity,
        acceleration=request.acceleration,
        deceleration=request.deceleration,
    )


def _turn(config: AxisConfig) -> int:
    """Microsteps of a turn of the motor."""
    return TURN if config.gearing is None else config.gearing.full_steps * config.gearing.microsteps


def _searched(config: AxisConfig) -> tuple[int, str]:
    """How far a homing may have to search, and why."""
    if config.soft_limits is not None:
        low, high = config.soft_limits
        return high - low, f"The way is at most the {high - low} steps between the software limits."
    travel = SEARCHED_TURNS * _turn(config)
    return travel, f"The way is at most {travel} steps, since the axis has no software limits."


def _prediction(way: Trajectory, start: int, end: int) -> Prediction:
    return Prediction(way.duration, way.peak_speed, start, end, (min(start, end), max(start, end)))
