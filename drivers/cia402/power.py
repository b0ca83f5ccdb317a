"""The power drive state machine: statusword to state, controlword to transition, goal to next controlword.

States and their coding: manual §6.1.2; commands: §6.1.1; numbered transitions: figure 9 and CiA 402.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final


class PowerState(enum.StrEnum):
    """A state of the power drive state machine of one axis."""

    NOT_READY_TO_SWITCH_ON = "not_ready_to_switch_on"
    SWITCH_ON_DISABLED = "switch_on_disabled"
    READY_TO_SWITCH_ON = "ready_to_switch_on"
    SWITCHED_ON = "switched_on"
    OPERATION_ENABLED = "operation_enabled"
    QUICK_STOP_ACTIVE = "quick_stop_active"
    FAULT_REACTION_ACTIVE = "fault_reaction_active"
    FAULT = "fault"


class Controlword:
    """Values and bits of 6040h."""

    DISABLE_VOLTAGE: Final = 0x00
    QUICK_STOP: Final = 0x02
    SHUTDOWN: Final = 0x06
    SWITCH_ON: Final = 0x07
    DISABLE_OPERATION: Final = 0x07
    """The same bits as SWITCH_ON; in OPERATION_ENABLED they ramp down (605Ch = 1) and go to SWITCHED_ON."""
    ENABLE_OPERATION: Final = 0x0F
    FAULT_RESET: Final = 0x80

    NEW_SET_POINT: Final = 1 << 4
    """pp: a 0-to-1 edge takes the target over."""
    START_HOMING: Final = 1 << 4
    """hm: 1 starts, 0 stops."""
    RELATIVE: Final = 1 << 6
    """pp: the target is relative, to what 60F2h says."""
    HALT: Final = 1 << 8
    """Ramp down and stay enabled (605Dh = 1). Not supported in hm."""


class Statusword:
    """Bits of 6041h beside those that code the state."""

    VOLTAGE_ENABLED: Final = 1 << 4
    WARNING: Final = 1 << 7
    REMOTE: Final = 1 << 9
    TARGET_REACHED: Final = 1 << 10
    INTERNAL_LIMIT: Final = 1 << 11
    BIT12: Final = 1 << 12
    """pp: 1 while a set point is in process. hm: home attained. csp, csv: the target is followed."""
    BIT13: Final = 1 << 13
    """csp: following error. Not supported in pp, pv and hm."""
    MOTOR_ACTIVITY: Final = 1 << 14
    """The maker's: the motor turns."""
    DIRECTION: Final = 1 << 15
    """The maker's: the direction of rotation. Which value is which is unverified on hardware."""


_STATE_MASK: Final = 0x6F
_CODING: Final[Mapping[PowerState, int]] = MappingProxyType(
    {
        PowerState.NOT_READY_TO_SWITCH_ON: 0x00,
        PowerState.SWITCH_ON_DISABLED: 0x40,
        PowerState.READY_TO_SWITCH_ON: 0x21,
        PowerState.SWITCHED_ON: 0x23,
        PowerState.OPERATION_ENABLED: 0x27,
        PowerState.QUICK_STOP_ACTIVE: 0x07,
        PowerState.FAULT_REACTION_ACTIVE: 0x0F,
        PowerState.FAULT: 0x08,
    }
)
_QUICK_STOP_BIT: Final = 0x20
_DONT_CARE: Final[Mapping[PowerState, int]] = MappingProxyType(
    dict.fromkeys(
        (
            PowerState.NOT_READY_TO_SWITCH_ON,
            PowerState.SWITCH_ON_DISABLED,
            PowerState.FAULT_REACTION_ACTIVE,
            PowerState.FAULT,
        ),
        _QUICK_STOP_BIT,
    )
)
_DECODED: Final[Mapping[int, PowerState]] = MappingProxyType(
    {code | extra: state for state, code in _CODING.items() for extra in (0, _DONT_CARE.get(state, 0))}
)


def decode_state(statusword: int) -> PowerState | None:
    """The state that a statusword codes, or None for a pattern that is no state."""
    return _DECODED.get(statusword & _STATE_MASK)


def encode_state(state: PowerState) -> int:
    """The statusword bits that code a state; all others 0."""
    return _CODING[state]


class Command(enum.StrEnum):
    """What the low bits of a controlword command."""

    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch_on"
    DISABLE_OPERATION = "switch_on"
    """An alias: the bits are those of SWITCH_ON, the state tells which is meant."""
    ENABLE_OPERATION = "enable_operation"
    DISABLE_VOLTAGE = "disable_voltage"
    QUICK_STOP = "quick_stop"
    FAULT_RESET = "fault_reset"


def command_of(controlword: int) -> Command:
    """The command in a controlword: every value is exactly one.

    While bit 7 is set nothing but a fault reset is commanded, as every other row of the manual's table wants
    it clear; whether the drive looks at the low bits nevertheless is unverified on hardware.
    """
    if controlword & 0x80:
        return Command.FAULT_RESET
    if not controlword & 0x02:
        return Command.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return Command.QUICK_STOP
    if not controlword & 0x01:
        return Command.SHUTDOWN
    return Command.ENABLE_OPERATION if controlword & 0x08 else Command.SWITCH_ON


_S: Final = PowerState
_TRANSITIONS: Final[Mapping[tuple[PowerState, Command], PowerState]] = MappingProxyType(
    {
        (_S.SWITCH_ON_DISABLED, Command.SHUTDOWN): _S.READY_TO_SWITCH_ON,  # 2
        (_S.READY_TO_SWITCH_ON, Command.SWITCH_ON): _S.SWITCHED_ON,  # 3
        (_S.READY_TO_SWITCH_ON, Command.ENABLE_OPERATION): _S.OPERATION_ENABLED,  # 3, then 4
        (_S.SWITCHED_ON, Command.ENABLE_OPERATION): _S.OPERATION_ENABLED,  # 4
        (_S.OPERATION_ENABLED, Command.DISABLE_OPERATION): _S.SWITCHED_ON,  # 5
        (_S.SWITCHED_ON, Command.SHUTDOWN): _S.READY_TO_SWITCH_ON,  # 6
        (_S.READY_TO_SWITCH_ON, Command.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,  # 7
        (_S.READY_TO_SWITCH_ON, Command.QUICK_STOP): _S.SWITCH_ON_DISABLED,  # 7
        (_S.OPERATION_ENABLED, Command.SHUTDOWN): _S.READY_TO_SWITCH_ON,  # 8
        (_S.OPERATION_ENABLED, Command.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,  # 9
        (_S.SWITCHED_ON, Command.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,  # 10
        (_S.SWITCHED_ON, Command.QUICK_STOP): _S.SWITCH_ON_DISABLED,  # 10
        (_S.OPERATION_ENABLED, Command.QUICK_STOP): _S.QUICK_STOP_ACTIVE,  # 11
        (_S.QUICK_STOP_ACTIVE, Command.DISABLE_VOLTAGE): _S.SWITCH_ON_DISABLED,  # 12
        (_S.FAULT, Command.FAULT_RESET): _S.SWITCH_ON_DISABLED,  # 15
        (_S.QUICK_STOP_ACTIVE, Command.ENABLE_OPERATION): _S.OPERATION_ENABLED,  # 16
    }
)


def transition(state: PowerState, controlword: int, previous_controlword: int) -> PowerState | None:
    """The state that a controlword leads to, or None if it changes nothing.

    Transitions 0, 1, 13 and 14, and 12 after a quick stop, happen by themselves and are not here. Number 15
    needs bit 7 to rise from `previous_controlword`; all others look at the level only. Where the manual lists
    "3,4" the result is the end, OPERATION_ENABLED.
    """
    command = command_of(controlword)
    if command is Command.FAULT_RESET and previous_controlword & Controlword.FAULT_RESET:
        return None
    return _TRANSITIONS.get((state, command))


class Unreachable(Exception):
    """No controlword brings the drive from `state` nearer to `goal`.

    FAULT is left by a fault reset only, FAULT_REACTION_ACTIVE by itself, and a fault is never a goal.
    """

    def __init__(self, state: PowerState, goal: PowerState) -> None:
        super().__init__(f"no controlword leads from {state} to {goal}")
        self.state = state
        self.goal = goal


_CW: Final = Controlword
_UPWARDS: Final = {
    _S.NOT_READY_TO_SWITCH_ON: _CW.DISABLE_VOLTAGE,
    _S.SWITCH_ON_DISABLED: _CW.SHUTDOWN,
    _S.READY_TO_SWITCH_ON: _CW.SWITCH_ON,
    _S.SWITCHED_ON: _CW.ENABLE_OPERATION,
}
_DOWNWARDS: Final = {
    _S.OPERATION_ENABLED: _CW.DISABLE_OPERATION,
    _S.SWITCHED_ON: _CW.SHUTDOWN,
    _S.READY_TO_SWITCH_ON: _CW.DISABLE_VOLTAGE,
    _S.QUICK_STOP_ACTIVE: _CW.DISABLE_VOLTAGE,
}
_LADDER: Final = (*_UPWARDS, _S.OPERATION_ENABLED)
_GOALS: Final = frozenset(_LADDER[1:]) | {_S.QUICK_STOP_ACTIVE}


def next_controlword(state: PowerState, goal: PowerState) -> int | None:
    """The controlword that brings the drive one state nearer to `goal`; None when it is there.

    Goals are SWITCH_ON_DISABLED to OPERATION_ENABLED, and QUICK_STOP_ACTIVE from OPERATION_ENABLED.
    Downwards it goes by 7 (which ramps, 605Ch = 1), 6 and 0: never by 6 or 0 from OPERATION_ENABLED, which
    cut the power at speed (605Bh = 0). From QUICK_STOP_ACTIVE, 0 is the only way down: send it at
    standstill. In NOT_READY_TO_SWITCH_ON, which the drive leaves by itself, it is 0, which commands
    nothing.

    Raises Unreachable from FAULT and FAULT_REACTION_ACTIVE (unless that is the goal, and so reached), and for
    any other goal.
    """
    if state is goal:
        return None
    if goal not in _GOALS or state in (_S.FAULT, _S.FAULT_REACTION_ACTIVE):
        raise Unreachable(state, goal)
    if goal is _S.QUICK_STOP_ACTIVE:
        if state is not _S.OPERATION_ENABLED:
            raise Unreachable(state, goal)
        return _CW.QUICK_STOP
    if state is _S.QUICK_STOP_ACTIVE:
        return _CW.ENABLE_OPERATION if goal is _S.OPERATION_ENABLED else _CW.DISABLE_VOLTAGE
    return (_UPWARDS if _LADDER.index(state) < _LADDER.index(goal) else _DOWNWARDS)[state]


def holding_controlword(state: PowerState) -> int:
    """The controlword that keeps the drive in `state`, with all mode-specific bits clear.

    To lower bit 4 or any other mode bit write this one and not 0Fh, which would switch a drive on that has
    meanwhile gone to READY_TO_SWITCH_ON. It is 0 in the states that no controlword holds.
    """
    return _HOLDING.get(state, _CW.DISABLE_VOLTAGE)


_HOLDING: Final = {
    _S.READY_TO_SWITCH_ON: _CW.SHUTDOWN,
    _S.SWITCHED_ON: _CW.SWITCH_ON,
    _S.OPERATION_ENABLED: _CW.ENABLE_OPERATION,
    _S.QUICK_STOP_ACTIVE: _CW.QUICK_STOP,
}
