"""THE table: which setting of an axis is held in which object of its module.

A setting that is None is left as the module holds it. What an object takes says the module's profile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from drivers.cia402 import objects
from drivers.devices.profile import DeviceProfile, ObjectSpec
from drivers.errors import BrokenRule, RulesBroken
from drivers.master.plan.configuration import AxisConfig

MICROSTEPS: Final = 0x2000
FULL_STEPS: Final = 0x2001
BRAKE_DELAYS: Final = 0x2002
RUN_CURRENT: Final = 0x2003
STANDBY_CURRENT: Final = 0x2004
SWITCH_PARAMETERS: Final = 0x2005
ENABLE_DELAY: Final = 0x200A
ENCODER: Final = 0x200B
BRAKE_CURRENTS: Final = 0x200C
START_VELOCITY: Final = 0x2010
RAMP_A1, RAMP_V1, RAMP_D1, RAMP_WAIT = 0x2011, 0x2012, 0x2013, 0x2015
RAMP_A2, RAMP_V2, RAMP_D2 = 0x2016, 0x2017, 0x2018
STANDBY_DELAY: Final = 0x2089

_FROM_ENCODER, _NO_ENCODER = 0, -1
"""606Ah (manual §5.1.8)."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One object that a setting is held in."""

    setting: str
    index: int
    """Of axis 0."""
    sub: int
    wanted: Callable[[AxisConfig], int | None]
    """What the object should hold; None: whatever it holds."""
    still: bool = False
    """Written only in SWITCH_ON_DISABLED though the manual allows it at any time: it changes what a step or
    a position is.
    """

    @property
    def key(self) -> tuple[int, int]:
        """Base index and sub-index."""
        return self.index, self.sub

    def needs_power_off(self, spec: ObjectSpec) -> bool:
        """Whether it is written in SWITCH_ON_DISABLED only."""
        return self.still or spec.writable_in is not None


def _plain(setting: str, index: int, sub: int = 0, *, attribute: str = "", still: bool = False) -> Parameter:
    return Parameter(setting, index, sub, attrgetter(attribute or setting), still)


PARAMETERS: Final = (
    Parameter("microsteps", MICROSTEPS, 0, lambda c: c.gearing and c.gearing.microstep_exponent, still=True),
    Parameter("full_steps", FULL_STEPS, 0, lambda c: c.gearing and c.gearing.full_steps, still=True),
    _plain("switch_parameters", SWITCH_PARAMETERS),
    Parameter(
        "encoder",
        objects.SENSOR_SELECTION,
        0,
        lambda c: None if c.encoder is None else _FROM_ENCODER if c.encoder else _NO_ENCODER,
        still=True,
    ),
    _plain("encoder_resolution", objects.ENCODER_RESOLUTION, 1, still=True),
    _plain("encoder_null_polarity", ENCODER, 1),
    _plain("encoder_direction", ENCODER, 2),
    _plain("encoder_initialize", ENCODER, 3),
    _plain("brake_apply_current", BRAKE_CURRENTS, 1),
    _plain("brake_release_current", BRAKE_CURRENTS, 2),
    _plain("brake_apply_delay", BRAKE_DELAYS, 1),
    _plain("brake_release_delay", BRAKE_DELAYS, 2),
    _plain("enable_delay", ENABLE_DELAY),
    _plain("run_current", RUN_CURRENT),
    _plain("standby_current", STANDBY_CURRENT),
    _plain("standby_delay", STANDBY_DELAY),
    _plain("position_window", objects.POSITION_WINDOW),
    _plain("position_window_time", objects.POSITION_WINDOW_TIME),
    _plain("following_error_window", objects.FOLLOWING_ERROR_WINDOW),
    _plain("start_velocity", START_VELOCITY),
    _plain("end_velocity", objects.END_VELOCITY),
    _plain("ramp_a1", RAMP_A1),
    _plain("ramp_v1", RAMP_V1),
    _plain("ramp_d1", RAMP_D1, attribute="d1"),
    _plain("ramp_a2", RAMP_A2),
    _plain("ramp_v2", RAMP_V2),
    _plain("ramp_d2", RAMP_D2, attribute="d2"),
    _plain("ramp_wait", RAMP_WAIT),
    _plain("velocity", objects.PROFILE_VELOCITY),
    _plain("acceleration", objects.PROFILE_ACCELERATION),
    _plain("deceleration", objects.PROFILE_DECELERATION),
    _plain("quick_stop_deceleration", objects.QUICK_STOP_DECELERATION),
    _plain("homing_method", objects.HOMING_METHOD),
    _plain("homing_fast", objects.HOMING_SPEEDS, 1),
    _plain("homing_slow", objects.HOMING_SPEEDS, 2),
    _plain("homing_acceleration", objects.HOMING_ACCELERATION),
    _plain("home_offset", objects.HOME_OFFSET),
    _plain("soft_limits", objects.SOFTWARE_LIMIT, 1, attribute="module_limits.lower"),
    _plain("soft_limits", objects.SOFTWARE_LIMIT, 2, attribute="module_limits.upper"),
)
"""In the order in which they are written."""

PAIRS: Final[Mapping[tuple[int, int], tuple[int, int]]] = {
    (START_VELOCITY, 0): (objects.END_VELOCITY, 0),
    (objects.SOFTWARE_LIMIT, 1): (objects.SOFTWARE_LIMIT, 2),
}
"""Of each two the first must never pass the second, on the way either."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """An object of one axis, and what it should hold."""

    parameter: Parameter
    spec: ObjectSpec
    value: int

    @property
    def needs_power_off(self) -> bool:
        """Whether it is written in SWITCH_ON_DISABLED only."""
        return self.parameter.needs_power_off(self.spec)


def wanted(config: AxisConfig, profile: DeviceProfile, axis: int) -> Iterator[Wanted]:
    """What an axis's objects should hold, in the order of writing; what the model has not is left out."""
    for parameter in PARAMETERS:
        value = parameter.wanted(config)
        if value is None:
            continue
        try:
            spec = profile.spec(parameter.index, parameter.sub, axis)
        except KeyError:
            continue
        yield Wanted(parameter, spec, value)


def check_ranges(config: AxisConfig, profile: DeviceProfile, axis: int) -> None:
    """Hold a configuration against what the objects of a model take. Raises `RulesBroken`."""
    broken = [
        BrokenRule(
            one.parameter.setting,
            f"range_{one.spec.base_index:X}h",
            f"{one.parameter.setting}: {one.spec.address} {one.spec.name} takes {_span(one.spec)}, not "
            f"{one.value} (manual §{one.spec.section}).",
        )
        for one in wanted(config, profile, axis)
        if one.spec.check(one.value) is not None
    ]
    if broken:
        raise RulesBroken(f"Axis {config.name!r}", tuple(broken))


def _span(spec: ObjectSpec) -> str:
    if spec.allowed is not None:
        return "one of " + ", ".join(str(value) for value in sorted(spec.allowed))
    return f"{spec.minimum}..{spec.maximum}{' ' + spec.unit if spec.unit else ''}"
