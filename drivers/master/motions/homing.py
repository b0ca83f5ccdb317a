"""Homing (manual §8): method and speeds, the start bit, and an end that is only sometimes a success."""

from __future__ import annotations

import asyncio
import contextlib

from drivers.cia402 import objects
from drivers.cia402.homing import HOMING_METHODS, HomingHandshake, HomingOutcome
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, PowerState
from drivers.errors import BusError, MotionFailed, MotionTimeout
from drivers.master.drive.tools import AxisTools, Parameter
from drivers.master.motions.motion import Motion, Result
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.prediction import predict_home
from drivers.master.plan.requests import HomeRequest
from drivers.master.seen.status import AxisStatus, Reference

_AT_ONCE = 3
"""In handshakes: how long a homing that moves nothing may take; a lost start is told by then."""


def needs_enabled(method: int) -> bool:
    """Whether the method turns the motor; 35 does not, and needs no power (manual §8.1.10)."""
    known = HOMING_METHODS.get(method)
    return known is None or known.moves


def parameters(config: AxisConfig, request: HomeRequest) -> dict[Parameter, int]:
    """What the module must hold for a homing."""
    return {
        (objects.HOMING_METHOD, 0): config.homing_method if request.method is None else request.method,
        (objects.HOMING_SPEEDS, 1): request.fast or config.homing_fast,
        (objects.HOMING_SPEEDS, 2): request.slow or config.homing_slow,
        (objects.HOMING_ACCELERATION, 0): request.acceleration or config.homing_acceleration,
    }


async def home(tools: AxisTools, request: HomeRequest, motion: Motion) -> Result:
    """Carry out a homing; sets `referenced` when it was attained."""
    config, drive = tools.config, tools.drive
    method = config.homing_method if request.method is None else request.method
    moves = needs_enabled(method)
    await tools.parameters.require(parameters(config, request))
    motion.prediction = longest = predict_home(config, request, drive.status.position)
    bound = longest.duration_s * tools.timing.motion_factor + tools.timing.motion_margin
    await attain(tools, method, motion, timeout_s=request.timeout_s or (bound if moves else None))
    drive.note_reference(Reference.HOMED)
    await drive.fresh_status()  # the position of before the jump to zero may still be shown
    return {"position": drive.status.position or 0, "method": method}


async def attain(tools: AxisTools, method: int, motion: Motion, *, timeout_s: float | None = None) -> None:
    """Run the homing whose parameters the module holds; returns when home is attained.

    `timeout_s`: how long it may take; None: as long as one that moves nothing may.

    The reference counts as lost from the start on: whoever calls says when it holds. Raises `MotionTimeout`,
    `MotionFailed`, `AxisFault`.
    """
    config, drive, timing = tools.config, tools.drive, tools.timing
    moves = needs_enabled(method)
    await tools.enter_mode(Mode.HOMING, drive.holding)
    if moves:
        tools.require_enabled(drive.status)

    loop = asyncio.get_running_loop()
    handshake = HomingHandshake(moves=moves, grace_s=timing.handshake)
    ended = HomingOutcome.RUNNING

    def over(status: AxisStatus) -> bool:
        nonlocal ended
        if moves:
            tools.require_enabled(status)
        elif status.state is PowerState.FAULT:
            raise tools.fault(status)
        ended = handshake.feed(status.statusword, loop.time())
        return ended is not HomingOutcome.RUNNING

    controlword = handshake.start(drive.status.statusword, loop.time())
    motion.begin()
    if drive.status.referenced:
        drive.note_reference(Reference.LOST)
    try:
        drive.command(controlword, Mode.HOMING)
        await drive.until(over, timeout_s or _AT_ONCE * timing.handshake)
    finally:
        if drive.controlword is not None and drive.controlword & Controlword.START_HOMING:
            with contextlib.suppress(BusError):  # a bus that is gone must not hide why the homing ended
                drive.command(handshake.release_controlword, Mode.HOMING)
    if ended is HomingOutcome.RUNNING:
        raise MotionTimeout(
            f"Axis {config.name} found no home with method {method} in time.",
            hint="Check the switches or the encoder that the method needs, and 2005h.",
            **tools.where,
        )
    if ended is HomingOutcome.STOPPED:
        raise MotionFailed(
            f"The homing of axis {config.name} was stopped by the drive before home was found.",
            hint="Look at the switches and the active emergencies, then home again.",
            **tools.where,
        )
    if not moves:
        drive.command(drive.holding, Mode.NO_MODE)
