"""Coming to rest: the ramp down, the set point that must not be taken up again, the way without PDOs."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, PowerState, Statusword, decode_state
from drivers.errors import BusError, MotionTimeout
from drivers.master.drive import power
from drivers.master.drive.tools import AxisTools
from drivers.master.plan.prediction import predict_stop
from drivers.master.sdo.client import Priority
from drivers.master.seen.status import AxisStatus

_POLL = 0.05


def begin(tools: AxisTools) -> None:
    """Send the halt now, if the drive is energised; take the enabling back, if it is just being enabled.

    As far as the bus takes it: what follows repeats it. It goes past whatever waits in the bus's queue, and
    commands of this axis that still wait there are taken back, so that no set point has the last word.
    """
    drive = tools.drive
    if drive.energised:
        _as_the_bus_takes_it(lambda: drive.halt(urgent=True))
    elif drive.being_enabled:
        drive.discard_waiting()
        _take_enabling_back(tools, urgent=True)


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
    drive.discard_waiting()
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
    drive = _ByObjects(tools)
    if decode_state(await drive.read(objects.STATUSWORD)) is not PowerState.OPERATION_ENABLED:
        return
    mode = await drive.read(objects.MODE_DISPLAY)
    if mode == Mode.PROFILE_VELOCITY:
        await drive.write(objects.TARGET_VELOCITY, 0)
    halt = 0 if mode == Mode.HOMING else Controlword.HALT
    await drive.write(objects.CONTROLWORD, Controlword.ENABLE_OPERATION | halt)
    if not await drive.comes_to_rest(_bound(tools)):
        await drive.write(objects.CONTROLWORD, Controlword.QUICK_STOP)
        raise _still_moving(tools, "a halt; quick stop was sent")
    await drive.write(objects.MODE, Mode.NO_MODE)
    await drive.write(objects.CONTROLWORD, Controlword.ENABLE_OPERATION)


async def quick_stop_by_sdo(tools: AxisTools) -> None:
    """As `stop_by_sdo`, by a quick stop; the power is off afterwards. Raises `SdoError`, `MotionTimeout`."""
    drive = _ByObjects(tools)
    if decode_state(await drive.read(objects.STATUSWORD)) is PowerState.OPERATION_ENABLED:
        await drive.write(objects.CONTROLWORD, Controlword.QUICK_STOP)
    if not await drive.comes_to_rest(_bound(tools)):
        raise _still_moving(tools, "a quick stop")
    await drive.write(objects.CONTROLWORD, Controlword.DISABLE_VOLTAGE)
    await drive.write(objects.MODE, Mode.NO_MODE)


class _ByObjects:
    """A drive commanded and watched by SDO alone, before all else that waits for the channel."""

    def __init__(self, tools: AxisTools) -> None:
        self._objects = tools.objects
        self._axis = tools.number

    async def read(self, index: int) -> int:
        address = self._objects.address(index, 0, self._axis)
        return await self._objects.read_int(address, priority=Priority.STOP)

    async def write(self, index: int, value: int) -> None:
        address = self._objects.address(index, 0, self._axis)
        await self._objects.write(address, value, priority=Priority.STOP)

    async def comes_to_rest(self, seconds: float) -> bool:
        """Look until the motor stands; False if it doesn't in time."""
        loop = asyncio.get_running_loop()
        deadline = loop.time() + seconds
        while await self.read(objects.STATUSWORD) & Statusword.MOTOR_ACTIVITY:
            if loop.time() > deadline:
                return False
            await asyncio.sleep(_POLL)
        return True


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
    timing = tools.timing
    ramp = predict_stop(tools.drive.status.velocity or 0, gentlest_ramp(tools))
    return ramp * timing.motion_factor + timing.standstill_margin


def gentlest_ramp(tools: AxisTools) -> int:
    """The lowest of the decelerations that are set, steps/s2: which of them a halt takes is the mode's."""
    config, parameters = tools.config, tools.parameters
    return min(
        parameters.held(objects.PROFILE_ACCELERATION, 0, config.acceleration),
        parameters.held(objects.PROFILE_DECELERATION, 0, config.deceleration),
        parameters.held(objects.HOMING_ACCELERATION, 0, config.homing_acceleration),
    )


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
