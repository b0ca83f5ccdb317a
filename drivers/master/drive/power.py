"""Walking the power drive state machine: enable, disable, reset a fault (CiA 402; manual figure 9)."""

from __future__ import annotations

from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, PowerState, Unreachable, next_controlword
from drivers.errors import TransitionTimeout
from drivers.master.drive.tools import AxisTools

_GOING_BY_ITSELF = frozenset({PowerState.FAULT_REACTION_ACTIVE, PowerState.NOT_READY_TO_SWITCH_ON})


async def reach(tools: AxisTools, goal: PowerState, *, mode: Mode) -> None:
    """Walk to `goal` one state at a time, with `mode` commanded alongside.

    Raises `AxisFault` if the drive is in FAULT, `TransitionTimeout` if a step takes longer than
    `Timing.transition`.
    """
    drive = tools.drive
    while (state := drive.status.state) is not goal:
        if state is None or state in _GOING_BY_ITSELF:
            await _leave(tools, state, None, mode)
            continue
        try:
            controlword = next_controlword(state, goal)
        except Unreachable as unreachable:
            raise tools.fault(drive.status) from unreachable
        if controlword is not None:
            await _leave(tools, state, controlword, mode)


async def _leave(tools: AxisTools, state: PowerState | None, controlword: int | None, mode: Mode) -> None:
    """Command and wait until the drive is in another state; power commands are levels, so they may be
    repeated.
    """
    drive = tools.drive

    def command() -> None:
        if controlword is not None:
            drive.command(controlword, mode)

    command()
    if not await drive.until(lambda s: s.state is not state, tools.timing.transition, resend=command):
        raise TransitionTimeout(
            f"Axis {tools.config.name} did not leave {state or 'its state'} in {tools.timing.transition} s.",
            **tools.where,
        )


async def enable(tools: AxisTools) -> None:
    """To OPERATION_ENABLED in mode 0, in which nothing moves whatever targets the module still holds."""
    if tools.drive.status.state is not PowerState.OPERATION_ENABLED:
        await reach(tools, PowerState.OPERATION_ENABLED, mode=Mode.NO_MODE)


async def disable(tools: AxisTools) -> None:
    """To SWITCH_ON_DISABLED: 7 (ramps down, 605Ch = 1), then 6, then 0.

    In FAULT there is nothing to switch off.
    """
    drive = tools.drive
    state = drive.status.state
    if state is PowerState.FAULT_REACTION_ACTIVE:
        await drive.until(lambda s: s.state is not PowerState.FAULT_REACTION_ACTIVE, tools.timing.transition)
        state = drive.status.state
    if state is not PowerState.FAULT:
        await reach(tools, PowerState.SWITCH_ON_DISABLED, mode=Mode.NO_MODE)


async def reset_fault(tools: AxisTools) -> None:
    """A rising edge of bit 7, to SWITCH_ON_DISABLED. Never enables.

    Nothing happens where there is no fault.
    """
    drive = tools.drive
    if drive.status.state is PowerState.FAULT_REACTION_ACTIVE:
        await drive.until(lambda s: s.state is not PowerState.FAULT_REACTION_ACTIVE, tools.timing.transition)
    if drive.status.state is not PowerState.FAULT:
        return

    def edge() -> None:
        drive.command(Controlword.DISABLE_VOLTAGE, Mode.NO_MODE)
        drive.command(Controlword.FAULT_RESET, Mode.NO_MODE)

    edge()
    try:
        left = await drive.until(
            lambda s: s.state not in (PowerState.FAULT, None), tools.timing.mode_change, resend=edge
        )
    finally:
        drive.command(Controlword.DISABLE_VOLTAGE, Mode.NO_MODE)
    if not left:
        raise tools.fault(drive.status)
