"""Which setting of an axis is held in which object of its module: the rows of `axis_fields`, and the others.

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
from drivers.master.plan.axis_fields import SETTINGS, START_VELOCITY
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.setting import Setting


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


def _held(name: str, row: Setting, at: tuple[int, int]) -> Parameter:
    """What a row of a setting comes to."""
    counted = attrgetter(row.counts or name)

    def wanted(config: AxisConfig) -> int | None:
        value = counted(config)
        return value if value is None or row.written is None else row.written(value)

    return Parameter(name, *at, wanted, row.still)


PARAMETERS: Final = (
    Parameter("microsteps", 0x2000, 0, lambda c: c.gearing and c.gearing.microstep_exponent, still=True),
    Parameter("full_steps", 0x2001, 0, lambda c: c.gearing and c.gearing.full_steps, still=True),
    *(_held(name, row, row.at) for name, row in SETTINGS.items() if row.at is not None),
    Parameter("soft_limits", objects.SOFTWARE_LIMIT, 1, lambda c: c.module_limits.lower),
    Parameter("soft_limits", objects.SOFTWARE_LIMIT, 2, lambda c: c.module_limits.upper),
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
