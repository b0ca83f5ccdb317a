"""Saying where an axis stands, without moving it: homing method 35 (manual §8.1.10).

With method 35 the present position is the home position, and the zero position is 607Ch further (§8.2.4): so
what the axis reads afterwards is -607Ch, which therefore holds the wanted position's negative for a moment.
The manual leaves open whether method 35 heeds 607Ch: the position is read back, and a module that takes
another one has failed. Unverified on hardware.

Travel limits (607Dh) are corrected by 607Ch all the time (§6.1.11). While that is lent they are opened, so
that a standing axis isn't found outside of them; both are back before anything else is commanded.
"""

from __future__ import annotations

import contextlib

from drivers.cia402 import objects
from drivers.errors import CanaxisError, MotionFailed, NotReady
from drivers.master.drive.tools import AxisTools
from drivers.master.motions.homing import attain
from drivers.master.motions.motion import Motion, Result
from drivers.master.motions.profile_position import check_target
from drivers.master.plan.configuration import INT32_MAX, INT32_MIN
from drivers.master.plan.requests import SetPositionRequest
from drivers.master.seen.status import Reference
from drivers.obstacles import LIMITS_WOULD_SHIFT

HERE = 35
"""The homing method that takes the present position as home."""


def check(tools: AxisTools, request: SetPositionRequest) -> None:
    """Raise `BadValue` for a position outside the travel limits, and `NotReady` where the limits would move.

    Limits are numbers in the axis's coordinates: another number for the same place moves them all. What a
    homing found is better than what somebody says, so that must be meant (`shift_limits`).
    """
    check_target(tools, request.position, "position")
    status = tools.drive.status
    shift = request.position - (status.position or 0)
    if tools.config.soft_limits is None or not status.referenced or not shift or request.shift_limits:
        return
    obstacle = LIMITS_WOULD_SHIFT.found(
        f"The axis is homed; with another position its travel limits would move by {-shift} steps."
    )
    raise NotReady(
        f"Axis {tools.config.name}: {obstacle.message}",
        hint=obstacle.remedy,
        obstacles=(obstacle,),
        node=tools.node_id,
        axis=tools.number,
    )


async def set_position(tools: AxisTools, request: SetPositionRequest, motion: Motion) -> Result:
    """Have the module count from here: it reads `request.position` afterwards, and counts as homed.

    Raises `MotionFailed` if it reads anything else, and what a homing raises.
    """
    config, drive = tools.config, tools.drive
    await tools.parameters.require({(objects.HOMING_METHOD, 0): HERE})
    try:
        await _lend(tools, -request.position)
        await attain(tools, HERE, motion)
    except BaseException:
        with contextlib.suppress(CanaxisError):  # what comes next tries again, before it moves anything
            await tools.parameters.settle()
        raise
    await tools.parameters.settle()
    await drive.fresh_status()
    position = drive.status.position
    if position is None or abs(position - request.position) > config.position_tolerance:
        raise MotionFailed(
            f"Axis {config.name} reads {position} instead of {request.position} after homing method 35.",
            hint="Set the position 0 if the module takes only that; else home the axis by a switch.",
            **tools.where,
        )
    drive.note_reference(Reference.HOMED)
    return {"position": position, "method": HERE}


async def _lend(tools: AxisTools, offset: int) -> None:
    """Have 607Ch hold `offset` for a while, if it doesn't already, with the limits out of the way."""
    config, parameters = tools.config, tools.parameters
    if offset == config.home_offset:
        return
    if config.soft_limits is not None:
        low, high = config.soft_limits
        await parameters.lend(objects.SOFTWARE_LIMIT, 1, INT32_MIN, owed=low)
        await parameters.lend(objects.SOFTWARE_LIMIT, 2, INT32_MAX, owed=high)
    await parameters.lend(objects.HOME_OFFSET, 0, offset, owed=config.home_offset)
