"""What can be asked of an axis, and what matters about it for whether it may be done now."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from drivers.master.plan.requests import (
    HomeRequest,
    JogRequest,
    MoveRequest,
    Request,
    SetPositionRequest,
    VelocityRequest,
)


class AxisCommand(enum.StrEnum):
    """What can be asked of an axis."""

    ENABLE = "enable"
    DISABLE = "disable"
    RESET_FAULT = "reset_fault"
    MOVE = "move"
    VELOCITY = "velocity"
    HOME = "home"
    SET_POSITION = "set_position"
    JOG = "jog"
    STOP = "stop"
    QUICK_STOP = "quick_stop"
    SETTINGS = "change_settings"

    @property
    def is_motion(self) -> bool:
        """Whether it is an operation: a latched stop prevents it, and so does an adopted axis."""
        return self in MOTION_COMMANDS


MOTION_COMMANDS = frozenset(
    {
        AxisCommand.MOVE,
        AxisCommand.VELOCITY,
        AxisCommand.HOME,
        AxisCommand.SET_POSITION,
        AxisCommand.JOG,
    }
)


@dataclass(frozen=True, slots=True)
class Question:
    """What matters about a command for whether it may be given."""

    command: AxisCommand
    absolute: bool = True
    """Of a move."""
    method: int | None = None
    """Of a homing; None: the configured one."""
    from_rest: bool = True
    """Whether the axis must stand when it begins."""

    @classmethod
    def of(cls, request: Request) -> Question:
        """About a request."""
        match request:
            case MoveRequest():
                return cls(AxisCommand.MOVE, absolute=not request.relative)
            case VelocityRequest():
                return cls(AxisCommand.VELOCITY, from_rest=request.travel is not None)
            case HomeRequest():
                return cls(AxisCommand.HOME, method=request.method)
            case SetPositionRequest():
                return cls(AxisCommand.SET_POSITION)
            case JogRequest():
                return cls(AxisCommand.JOG)

    @classmethod
    def about(cls, command: AxisCommand, *, absolute: bool = True, method: int | None = None) -> Question:
        """About a command as such: what moves or changes settings begins from rest, a velocity doesn't."""
        from_rest = command is AxisCommand.SETTINGS or (
            command.is_motion and command is not AxisCommand.VELOCITY
        )
        return cls(command, absolute, method, from_rest)
