"""A move in profile position mode: parameters, set-point handshake, arrival (manual §6)."""

from __future__ import annotations

import asyncio
import contextlib

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, Statusword
from drivers.cia402.setpoint import Evidence, SetPointHandshake, SetPointStep
from drivers.errors import BadValue, BusError, MotionFailed, MotionTimeout
from drivers.master.drive.tools import AxisTools, Parameter
from drivers.master.motions.motion import Motion, Result
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.prediction import predict_move
from drivers.master.plan.requests import MoveRequest
from drivers.master.sdo.client import Priority
from drivers.master.seen.status import AxisStatus


def check_target(tools: AxisTools, target: int, what: str = "target") -> None:
    """Raise `BadValue` for a target, or another position, that the drive would refuse."""
    low, high = tools.config.target_range
    if not low <= target <= high:
        raise BadValue(
            f"Axis {tools.config.name}: the {what} {target} is outside {low}..{high} steps.",
            hint=f"Give a {what} within the axis's limits.",
            **tools.where,
        )


def parameters(config: AxisConfig, request: MoveRequest) -> dict[Parameter, int]:
    """What the module must hold for a move."""
    return {
        (objects.PROFILE_VELOCITY, 0): request.velocity or config.velocity,
        (objects.PROFILE_ACCELERATION, 0): request.acceleration or config.acceleration,
        (objects.PROFILE_DECELERATION, 0): request.deceleration or config.deceleration,
    }


async def move(tools: AxisTools, request: MoveRequest, motion: Motion) -> Result:
    """Carry out a move; returns at standstill on the target.

    A relative move is sent as an absolute one, from the demand position (6062h) that the standing axis has
    now: what 60F2h = 0 would add to, the preceding target, is not where the axis stands after a stop or a
    rotation, and an absolute set point can't move twice if it should arrive twice.
    """
    config, drive, timing = tools.config, tools.drive, tools.timing
    await tools.parameters.require(parameters(config, request))
    demand = tools.objects.address(objects.POSITION_DEMAND, 0, tools.number)
    start = await tools.objects.read_int(demand, priority=Priority.CONTROL)
    target = start + request.target if request.relative else request.target
    check_target(tools, target)
    motion.evidence.aim(motion.axis, target)
    await tools.enter_mode(Mode.PROFILE_POSITION)
    tools.require_enabled(drive.status)

    expected = predict_move(
        config,
        start,
        target,
        velocity=request.velocity,
        acceleration=request.acceleration,
        deceleration=request.deceleration,
    )
    motion.prediction = expected
    bound = expected.duration_s * timing.motion_factor
    arrival = _Arrival(tools, motion, start, target)
    try:
        arrival.hand_over()
        await arrival.handed_over()
        if not await drive.until(arrival.check, bound + timing.motion_margin):
            raise MotionTimeout(
                f"Axis {config.name} did not reach {target} in the time that the move should take.",
                hint="Check load, current and ramps of the axis; it was told to stop.",
                **tools.where,
            )
    finally:
        with contextlib.suppress(BusError):  # a bus that is gone must not hide why the move ended
            drive.lower_set_point()
    drive.command_position(
        Controlword.ENABLE_OPERATION, target
    )  # once more: the wire may have lost the first
    await drive.until(lambda status: status.velocity == 0, 1.5 * timing.pdo_event_timer)
    return {"position": drive.status.position or 0, "target": target}


class _Arrival:
    """One set point on its way: the handshake, then the look-out for the end."""

    def __init__(self, tools: AxisTools, motion: Motion, start: int, target: int) -> None:
        self._tools = tools
        self._motion = motion
        self._start = start
        self._target = target
        self._handshake = SetPointHandshake(tools.timing.handshake)
        self._standing_since: float | None = None

    def hand_over(self) -> None:
        """Send the target with bit 4 low, then the edge. Never repeated."""
        drive = self._tools.drive
        drive.command_position(Controlword.ENABLE_OPERATION, self._target)
        now = asyncio.get_running_loop().time()
        controlword = self._handshake.start(drive.status.statusword, now)
        self._motion.begin()
        drive.command_position(controlword, self._target)

    async def handed_over(self) -> None:
        """Wait until the set point is taken and lower bit 4.

        Raises `MotionTimeout` if nothing shows that it was.
        """
        drive, timing = self._tools.drive, self._tools.timing
        await drive.until(self._taken, timing.handshake)
        drive.lower_set_point()
        if self._handshake.evidence is Evidence.NONE and not self._there(drive.status):
            raise MotionTimeout(
                f"Axis {self._tools.config.name} did not take the set point {self._target}.",
                hint="Nothing is sent twice: look at the axis's status, then command the move again.",
                **self._tools.where,
            )

    def check(self, status: AxisStatus) -> bool:
        """Whether the axis has arrived. Raises if it never will."""
        self._tools.require_enabled(status)
        self._note_progress(status)
        if self._there(status):
            return True
        now = asyncio.get_running_loop().time()
        if status.moving or self._standing_since is None:
            self._standing_since = now
        elif now - self._standing_since > self._tools.timing.stuck:
            raise self._stands(status)
        return False

    def _taken(self, status: AxisStatus) -> bool:
        self._tools.require_enabled(status)
        step = self._handshake.feed(status.statusword, asyncio.get_running_loop().time())
        return step in (SetPointStep.RELEASE, SetPointStep.DONE)

    def _there(self, status: AxisStatus) -> bool:
        return (
            status.target_reached
            and not status.moving
            and not status.statusword & Statusword.BIT12
            and status.position is not None
            and abs(status.position - self._target) <= self._tools.config.position_tolerance
        )

    def _note_progress(self, status: AxisStatus) -> None:
        distance = abs(self._target - self._start)
        if distance and status.position is not None:
            self._motion.progress = min(1.0, max(0.0, abs(status.position - self._start) / distance))

    def _stands(self, status: AxisStatus) -> MotionFailed:
        switches = status.switches
        why = "; a limit switch is engaged" if switches.negative_limit or switches.positive_limit else ""
        return MotionFailed(
            f"Axis {self._tools.config.name} stands at {status.position} instead of {self._target}{why}.",
            hint="Look for a limit switch, a software limit (607Dh), an obstacle or too low a current.",
            **self._tools.where,
        )
