"""Coming to rest: the ramp down, the set point that must not be taken up again, the way without PDOs."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, PowerState, Statusword, decode_state
from drivers.errors import BusError, MotionTimeout
from drivers.master import power
from drivers.master.axis_tools import AxisTools
from drivers.master.ramps import velocity_change_duration
from drivers.master.sdo_client import Priority
from drivers.master.status import AxisStatus

_POLL = 0.05


def begin(tools: AxisTools) -> None:
    """Send the halt now, if the drive is energised; take the enabling back, if it is just being enabled.

    As far as the bus takes it: what follows repeats it. Twice: once past whatever waits in the bus's queue,
    and once behind it, so that no set point that was queued before the stop has the last word.
    """
    drive = tools.drive
    if drive.energised:
        _as_the_bus_takes_it(lambda: drive.halt(urgent=True))
        halt_again(tools)
    elif drive.being_enabled:
        _take_enabling_back(tools, urgent=True)
        _take_enabling_back(tools, urgent=False)


async def come_to_rest(tools: AxisTools) -> None:
    """After `begin`: wait for standstill, then discard the set point. Ends OPERATION_ENABLED in mode 0 if it
    was, and SWITCHED_ON if it was just being enabled; the status is of that time then.

    A released halt would go on with an interrupted move (CiA 402), so the mode is set to 0 while the halt is
    still on; only then the halt is taken back. Raises `MotionTimeout` if the axis does not come to
    standstill; quick stop was then tried too.
    """
    drive = tools.drive
    if not await drive.until(_at_rest, _bound(tools), resend=lambda: halt_again(tools)):
        await _escalate(tools)
        return
    if drive.energised:
        await tools.enter_mode(Mode.NO_MODE, Controlword.ENABLE_OPERATION | Controlword.HALT)
        # 6061h = 0 was seen after the halt took effect, so this standstill is no remnant of the time before.
        if not await drive.until(_at_rest, _bound(tools)):
            await _escalate(tools)
            return
        if drive.energised:
            drive.command(Controlword.ENABLE_OPERATION, Mode.NO_MODE)
    await drive.fresh_status()
    if (
        drive.controlword == Controlword.DISABLE_OPERATION
        and drive.status.state is PowerState.OPERATION_ENABLED
    ):
        # The enabling got through before it was taken back.
        await power.reach(tools, PowerState.SWITCHED_ON, mode=Mode.NO_MODE)


def begin_quick_stop(tools: AxisTools) -> None:
    """Send the quick stop now (605Ah = 2: ramps with 6085h, then SWITCH_ON_DISABLED), as far as the bus takes
    it.
    """
    drive = tools.drive
    _as_the_bus_takes_it(lambda: drive.command(Controlword.QUICK_STOP, drive.mode, urgent=True))


async def finish_quick_stop(tools: AxisTools) -> None:
    """After `begin_quick_stop`: wait for standstill and for the power to be off. Raises `MotionTimeout`."""
    drive = tools.drive

    def resend() -> None:
        _as_the_bus_takes_it(lambda: drive.command(Controlword.QUICK_STOP, drive.mode))

    off = frozenset({PowerState.SWITCH_ON_DISABLED, PowerState.FAULT, PowerState.NOT_READY_TO_SWITCH_ON})
    if not await drive.until(lambda s: not s.moving and s.state in off, _bound(tools), resend=resend):
        raise _still_moving(tools, "a quick stop")
    drive.command(Controlword.DISABLE_VOLTAGE, Mode.NO_MODE)
    await drive.fresh_status()


async def stop_by_sdo(tools: AxisTools) -> None:
    """Stop a drive whose PDOs don't flow (NMT Pre-operational), by SDO with the highest priority.

    Raises `SdoError` or `MotionTimeout`.
    """
    loop = asyncio.get_running_loop()
    access, axis = tools.objects, tools.number

    async def read(index: int) -> int:
        return await access.read_int(access.address(index, 0, axis), priority=Priority.STOP)

    async def write(index: int, value: int) -> None:
        await access.write(access.address(index, 0, axis), value, priority=Priority.STOP)

    if decode_state(await read(objects.STATUSWORD)) is not PowerState.OPERATION_ENABLED:
        return
    mode = await read(objects.MODE_DISPLAY)
    if mode == Mode.PROFILE_VELOCITY:
        await write(objects.TARGET_VELOCITY, 0)
    halt = 0 if mode == Mode.HOMING else Controlword.HALT
    await write(objects.CONTROLWORD, Controlword.ENABLE_OPERATION | halt)
    deadline = loop.time() + _bound(tools)
    while await read(objects.STATUSWORD) & Statusword.MOTOR_ACTIVITY:
        if loop.time() > deadline:
            await write(objects.CONTROLWORD, Controlword.QUICK_STOP)
            raise _still_moving(tools, "a halt; quick stop was sent")
        await asyncio.sleep(_POLL)
    await write(objects.MODE, Mode.NO_MODE)
    await write(objects.CONTROLWORD, Controlword.ENABLE_OPERATION)


def _at_rest(status: AxisStatus) -> bool:
    return not status.moving and not status.stale


def halt_again(tools: AxisTools) -> None:
    """Repeat the halt, as far as the bus takes it; it is a level, so that does no harm."""
    if tools.drive.energised:
        _as_the_bus_takes_it(lambda: tools.drive.halt(urgent=False))


def _take_enabling_back(tools: AxisTools, *, urgent: bool) -> None:
    """From wherever the enabling got to, to SWITCHED_ON; with a ramp, should anything turn (605Ch = 1)."""
    drive = tools.drive
    _as_the_bus_takes_it(lambda: drive.command(Controlword.DISABLE_OPERATION, Mode.NO_MODE, urgent=urgent))


def _as_the_bus_takes_it(send: Callable[[], None]) -> None:
    """A full queue or a lost wire ends no coming to rest: it is sent again, and the bus says what it has."""
    with contextlib.suppress(BusError):
        send()


def _bound(tools: AxisTools) -> float:
    """How long the ramp down may take: from the velocity now, with the gentlest ramp that is set."""
    config, timing, parameters = tools.config, tools.timing, tools.parameters
    gentlest = min(
        parameters.held(objects.PROFILE_ACCELERATION, 0, config.acceleration),
        parameters.held(objects.PROFILE_DECELERATION, 0, config.deceleration),
        parameters.held(objects.HOMING_ACCELERATION, 0, config.homing_acceleration),
    )
    ramp = velocity_change_duration(tools.drive.status.velocity or 0, 0, gentlest)
    return ramp * timing.motion_factor + timing.standstill_margin


async def _escalate(tools: AxisTools) -> None:
    begin_quick_stop(tools)
    await finish_quick_stop(tools)
    raise MotionTimeout(
        f"Axis {tools.config.name} did not come to standstill by a halt in time; a quick stop ended it.",
        hint="The axis is disabled now. Check its deceleration, then enable it again.",
        **tools.where,
    )


def _still_moving(tools: AxisTools, after: str) -> MotionTimeout:
    return MotionTimeout(
        f"Axis {tools.config.name} was not seen to stand after {after}.",
        hint="Use the module's enable input or cut the motor supply; then look for a second master.",
        **tools.where,
    )
