"""Turning at a velocity in profile velocity mode (manual §7)."""

from __future__ import annotations

import asyncio

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword
from drivers.errors import MotionFailed, MotionTimeout
from drivers.master.axis_tools import AxisTools
from drivers.master.motion import Motion, Result
from drivers.master.prediction import predict_velocity
from drivers.master.requests import VelocityRequest
from drivers.master.sdo_client import Priority
from drivers.master.status import AxisStatus

_TOLERANCE = 0.01
"""How far the actual velocity may be off, relative: the ramp generator rounds to its own units."""
_ROUNDING = 2
"""The same, in steps/s, for low velocities."""


async def run(tools: AxisTools, request: VelocityRequest, motion: Motion) -> Result:
    """Bring the axis to a velocity; returns when it has it. It goes on turning until told otherwise."""
    config, drive, timing = tools.config, tools.drive, tools.timing
    acceleration = request.acceleration or config.acceleration
    await enter(tools, acceleration)

    start = drive.status.velocity or 0
    approach = _Approach(tools, motion, start, request.velocity)
    position = drive.status.position or 0
    expected = predict_velocity(config, position, start, request.velocity, acceleration=acceleration)
    bound = expected.duration_s * timing.motion_factor
    motion.begin()
    drive.command_velocity(Controlword.ENABLE_OPERATION, request.velocity)
    if not await drive.until(approach.check, bound + timing.motion_margin):
        raise MotionTimeout(
            f"Axis {config.name} did not reach {request.velocity} steps/s in the time that it should take.",
            hint="Check load, current and acceleration of the axis; it was told to stop.",
            **tools.where,
        )
    await drive.fresh_motion()
    return {
        "velocity": drive.status.velocity or 0,
        "position": drive.status.position or 0,
        "turning": request.velocity != 0,
    }


async def enter(tools: AxisTools, acceleration: int) -> None:
    """Have the drive in profile velocity mode and ready, at the velocity that it has; it turns no faster yet.

    Raises `AxisFault`, `MotionFailed` or `TransitionTimeout`.
    """
    drive = tools.drive
    await tools.parameters.require({(objects.PROFILE_ACCELERATION, 0): acceleration})
    if not (drive.mode is Mode.PROFILE_VELOCITY and drive.status.mode is Mode.PROFILE_VELOCITY):
        # What 60FFh still holds would start the motor together with the mode: zero it by SDO, confirmed.
        address = tools.objects.address(objects.TARGET_VELOCITY, 0, tools.number)
        await tools.objects.write(address, 0, priority=Priority.CONTROL)
        await tools.enter_mode(Mode.PROFILE_VELOCITY)
    tools.require_enabled(drive.status)


class _Approach:
    """The look-out for a velocity."""

    def __init__(self, tools: AxisTools, motion: Motion, start: int, target: int) -> None:
        self._tools = tools
        self._motion = motion
        self._start = start
        self._target = target
        self._standing_since: float | None = None

    def check(self, status: AxisStatus) -> bool:
        """Whether the velocity is reached. Raises if it never will be."""
        self._tools.require_enabled(status)
        velocity = status.velocity or 0
        change = abs(self._target - self._start)
        if change:
            self._motion.progress = min(1.0, max(0.0, abs(velocity - self._start) / change))
        near = abs(velocity - self._target) <= max(_ROUNDING, abs(self._target) * _TOLERANCE)
        if near and status.target_reached and status.moving is (self._target != 0):
            return True
        now = asyncio.get_running_loop().time()
        if status.moving or self._target == 0 or self._standing_since is None:
            self._standing_since = now
        elif now - self._standing_since > self._tools.timing.stuck:
            raise MotionFailed(
                f"Axis {self._tools.config.name} stands still though {self._target} steps/s were commanded.",
                hint="Look for a limit switch, an obstacle or too low a current.",
                **self._tools.where,
            )
        return False
