"""Turning at a velocity in profile velocity mode (manual §7)."""

from __future__ import annotations

import asyncio

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword
from drivers.errors import MotionFailed, MotionTimeout
from drivers.master.drive.drive import Drive
from drivers.master.drive.tools import AxisTools, Parameter
from drivers.master.motions import profile_position
from drivers.master.motions.motion import Motion, Result
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.prediction import predict_turning, predict_velocity
from drivers.master.plan.requests import VelocityRequest
from drivers.master.sdo.client import Priority
from drivers.master.seen.status import AxisStatus

_TOLERANCE = 0.01
"""How far the actual velocity may be off, relative: the ramp generator rounds to its own units."""
_ROUNDING = 2
"""The same, in steps/s, for low velocities."""


def parameters(config: AxisConfig, request: VelocityRequest) -> dict[Parameter, int]:
    """What the module must hold for a velocity."""
    if (move := request.as_move) is not None:
        return profile_position.parameters(config, move)
    return {(objects.PROFILE_ACCELERATION, 0): request.acceleration or config.acceleration}


async def run(tools: AxisTools, request: VelocityRequest, motion: Motion) -> Result:
    """Bring the axis to a velocity, and to the end that the request may give.

    Without one it returns at the velocity, and the axis goes on turning until told otherwise. A `travel` is
    a move, so the module itself ends it, to the step. A `duration_s` counts from when the drive said that it
    has its velocity: some 10 ms late at most.
    """
    if (move := request.as_move) is not None:
        return {**await profile_position.move(tools, move, motion), "turning": False}
    config, drive = tools.config, tools.drive
    await enter(tools, request.acceleration or config.acceleration)

    status = drive.status
    motion.prediction = predict_turning(config, status.position or 0, status.velocity or 0, request)
    motion.begin()
    run = _Turning(tools, motion, request)
    await run.reach(request.velocity)
    if request.held:
        while True:  # somebody ends it, or something
            await drive.until(run.goes_on, 3600.0)
    if request.duration_s is not None:
        await drive.until(run.goes_on, request.duration_s)
        await run.reach(0)
    await drive.fresh_motion()
    return {
        "velocity": drive.status.velocity or 0,
        "position": drive.status.position or 0,
        "turning": bool(request.velocity) and request.duration_s is None,
    }


async def enter(tools: AxisTools, acceleration: int) -> None:
    """Have the drive in profile velocity mode and ready, at the velocity that it has; it turns no faster yet.

    Raises `AxisFault`, `MotionFailed` or `TransitionTimeout`.
    """
    drive = tools.drive
    await tools.parameters.require({(objects.PROFILE_ACCELERATION, 0): acceleration})
    if not in_velocity(drive):
        # What 60FFh still holds would start the motor together with the mode: zero it by SDO, confirmed.
        address = tools.objects.address(objects.TARGET_VELOCITY, 0, tools.number)
        await tools.objects.write(address, 0, priority=Priority.CONTROL)
        await tools.enter_mode(Mode.PROFILE_VELOCITY)
    tools.require_enabled(drive.status)


def in_velocity(drive: Drive) -> bool:
    """Whether another velocity needs no change of the mode."""
    return drive.mode is Mode.PROFILE_VELOCITY and drive.status.mode is Mode.PROFILE_VELOCITY


class _Turning:
    """One velocity command: the ramps, and the look-out for what goes wrong meanwhile."""

    def __init__(self, tools: AxisTools, motion: Motion, request: VelocityRequest) -> None:
        self._tools = tools
        self._motion = motion
        self._request = request
        self._start = tools.drive.status.velocity or 0
        self._began = asyncio.get_running_loop().time()
        self._target = 0
        self._standing_since: float | None = None

    async def reach(self, velocity: int) -> None:
        """Command a velocity and wait until the drive has it. Raises `MotionTimeout`, `MotionFailed`."""
        tools, drive, timing = self._tools, self._tools.drive, self._tools.timing
        status = drive.status
        expected = predict_velocity(
            tools.config,
            status.position or 0,
            status.velocity or 0,
            velocity,
            acceleration=self._request.acceleration,
        )
        self._target = velocity
        self._standing_since = None
        drive.command_velocity(Controlword.ENABLE_OPERATION, velocity)
        bound = expected.duration_s * timing.motion_factor + timing.motion_margin
        if not await drive.until(self._has_it, bound):
            raise MotionTimeout(
                f"Axis {tools.config.name} did not reach {velocity} steps/s in the time that it should take.",
                hint="Check load, current and acceleration of the axis; it was told to stop.",
                **tools.where,
            )

    def goes_on(self, status: AxisStatus) -> bool:
        """Never true: raises `MotionFailed` once the axis turns no more."""
        self._look(status)
        return False

    def _has_it(self, status: AxisStatus) -> bool:
        self._look(status)
        velocity = status.velocity or 0
        near = abs(velocity - self._target) <= max(_ROUNDING, abs(self._target) * _TOLERANCE)
        return near and status.target_reached and status.moving is (self._target != 0)

    def _look(self, status: AxisStatus) -> None:
        self._tools.require_enabled(status)
        self._note_progress(status)
        now = asyncio.get_running_loop().time()
        if status.moving or self._target == 0 or self._standing_since is None:
            self._standing_since = now
        elif now - self._standing_since > self._tools.timing.stuck:
            raise MotionFailed(
                f"Axis {self._tools.config.name} stands still though {self._target} steps/s were commanded.",
                hint="Look for a limit switch, an obstacle or too low a current.",
                **self._tools.where,
            )

    def _note_progress(self, status: AxisStatus) -> None:
        """Of the ramp; with a duration, of the whole time. Until a stop nobody knows."""
        if self._request.held:
            return
        expected = self._motion.prediction
        if self._request.duration_s is not None and expected is not None:
            done = (asyncio.get_running_loop().time() - self._began) / expected.duration_s
        elif change := abs(self._target - self._start):
            done = abs((status.velocity or 0) - self._start) / change
        else:
            return
        self._motion.progress = min(1.0, max(0.0, done))
