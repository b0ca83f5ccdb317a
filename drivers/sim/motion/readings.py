"""The live objects of an axis, by the index that the manual prints for motor 0."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, Protocol

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Statusword, encode_state
from drivers.sim.motion import load
from drivers.sim.motion.context import SWITCH_PARAMETERS, VELOCITY_DIMENSION, Context
from drivers.sim.motion.encoder import MICROSTEP_RESOLUTION
from drivers.sim.motion.mode import ModeControl
from drivers.sim.motion.supervision import STALLGUARD2_THRESHOLD, Supervision
from drivers.sim.motion.travel import SwitchParameters
from drivers.sim.motion.troubles import Conditions, Severity

_PPS: Final = 181
_PPS_PER_S: Final = 179
_MEASURED_LIMIT: Final = 16_777_215


class Readable(Protocol):
    """What the live objects of an axis are read from."""

    context: Context
    conditions: Conditions
    supervision: Supervision
    mode: Mode

    @property
    def control(self) -> ModeControl:
        """The mode that is displayed."""
        ...

    @property
    def deviated(self) -> bool:
        """Whether a following error happened since the last fault reset."""
        ...


def statusword(axis: Readable, now: float) -> int:
    """6041h. Bit 15 is set when the last motion was, or is, in negative direction: unverified on hardware."""
    word = encode_state(axis.context.drive.state) | Statusword.REMOTE | axis.control.bits(now)
    if axis.conditions.voltage >= Conditions.UNDERVOLTAGE:
        word |= Statusword.VOLTAGE_ENABLED
    if any(trouble.value.severity is Severity.WARNING for trouble in axis.conditions.present()):
        word |= Statusword.WARNING
    if axis.supervision.limited:
        word |= Statusword.INTERNAL_LIMIT
    if axis.deviated and axis.mode is axis.mode.CYCLIC_SYNC_POSITION:
        word |= Statusword.BIT13
    if axis.context.motor.turning(now):
        word |= Statusword.MOTOR_ACTIVITY
    if axis.context.motor.last_direction < 0:
        word |= Statusword.DIRECTION
    return word


def velocity(axis: Readable, now: float) -> int:
    """606Ch in the unit of 208Ch: of the encoder where one is used and the carriage is held."""
    held = axis.context.encoder.used and axis.context.motor.stuck is not None
    shown = 0 if held else round(axis.context.motor.velocity(now) / axis.context.velocity_unit)
    return max(min(shown, 2**31 - 1), -(2**31))


def digital_inputs(axis: Readable, now: float) -> int:
    """60FDh: switches after polarity, used or not. The bits are CiA 402's: unverified on hardware."""
    bits = SwitchParameters(axis.context.parameters.get(SWITCH_PARAMETERS))
    levels = axis.context.travel.levels(axis.context.motor.place(now), bits)
    inputs = objects.DigitalInput
    return (
        levels.negative * inputs.NEGATIVE_LIMIT
        | levels.positive * inputs.POSITIVE_LIMIT
        | levels.home * inputs.HOME_SWITCH
        | axis.conditions.shutdown * inputs.INTERLOCK
    )


def _demand(axis: Readable, now: float) -> int:
    return _wrapped(round(axis.context.motor.position(now)))


def _position(axis: Readable, now: float) -> int:
    return _wrapped(axis.context.encoder.shown(now))


def _measured_velocity(axis: Readable, now: float) -> int:
    if axis.context.motor.stuck is not None:
        return 0
    return max(min(velocity(axis, now), _MEASURED_LIMIT), -_MEASURED_LIMIT)


def _load(axis: Readable, now: float) -> int:
    threshold = axis.context.parameters.get(STALLGUARD2_THRESHOLD)
    return load.stallguard2(axis.supervision.effective_load, axis.context.motor.velocity(now), threshold)


def _load4(axis: Readable, now: float) -> int:
    return load.stallguard4(axis.supervision.effective_load, axis.context.motor.velocity(now))


def _wrapped(value: int) -> int:
    """The counter has 32 bits and runs over."""
    return (value + 2**31) % 2**32 - 2**31


LIVE: Final[Mapping[int, Callable[[Readable, float], int]]] = MappingProxyType(
    {
        0x208E: lambda axis, _: _PPS_PER_S if axis.context.parameters.get(VELOCITY_DIMENSION) == _PPS else 0,
        0x2100: lambda axis, _: axis.context.parameters.get(objects.HOME_OFFSET),
        0x2101: _load,
        0x2102: lambda axis, _: axis.conditions.driver_flags(),
        0x2107: lambda axis, _: axis.context.parameters.get(MICROSTEP_RESOLUTION),
        0x210A: _load4,
        0x2121: lambda axis, now: load.pwm_scale(
            axis.context.motor.velocity(now), axis.context.drive.powered
        ),
        0x2122: _measured_velocity,
        objects.STATUSWORD: statusword,
        objects.MODE_DISPLAY: lambda axis, _: int(axis.mode),
        objects.POSITION_DEMAND: _demand,
        objects.POSITION_INTERNAL: _position,
        objects.POSITION: _position,
        objects.VELOCITY: velocity,
        objects.DIGITAL_INPUTS: digital_inputs,
    }
)
