"""How an axis is found, and what it must hold before it may be used: safe options, ramps that are not zero.

The order of the writes matters where the module compares two objects with each other (VSTOP with VSTART, one
software limit with the other).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from drivers.cia402 import objects
from drivers.cia402.power import PowerState, Statusword, decode_state
from drivers.errors import NotReady
from drivers.master.drive.tools import AxisTools
from drivers.master.link.holding import Establisher
from drivers.master.plan.axis_parameters import PAIRS, Wanted, wanted
from drivers.master.plan.configuration import AxisConfig
from drivers.master.sdo.client import Priority
from drivers.obstacles import DISABLE_TO_CLAIM

VELOCITY_DIMENSION = 0x208C
PULSES_PER_SECOND = 181
"""208Ch: velocities in pps, accelerations in pps/s (manual §4.2.19)."""
QUICK_STOP_RAMP_THEN_OFF = 2
"""605Ah: slow down with 6085h, then SWITCH_ON_DISABLED (manual §5.1.1)."""


class Found(NamedTuple):
    """An axis as an SDO reads it."""

    statusword: int
    """6041h"""
    mode: int
    """6061h"""
    position: int
    """6064h, steps"""
    velocity: int
    """606Ch, steps/s"""


class AxisSetup:
    """Looks at and configures one axis by SDO; only what differs is written, and read back.

    Raises `ConfigurationRefused` with what differs, and `SdoError`, `BusError`.
    """

    def __init__(self, tools: AxisTools, establisher: Establisher) -> None:
        self._tools = tools
        self._establisher = establisher

    async def look(self) -> Found:
        """What the axis does, without touching it."""
        return Found(
            await self._read(objects.STATUSWORD),
            await self._read(objects.MODE_DISPLAY),
            await self._read(objects.POSITION),
            await self._read(objects.VELOCITY),
        )

    async def configure(self, statusword: int) -> str:
        """Everything, for an axis that stands; else why the rest must wait until somebody claims the axis.

        `make_safe` is done in any case.
        """
        await self.make_safe()
        if is_running(statusword):
            return "It was found enabled or turning; nobody has claimed it."
        if decode_state(statusword) is PowerState.SWITCH_ON_DISABLED:
            await self._establish_without_power()
        elif wrong := await self._differences_that_need_power_off():
            return f"It was found switched on, and nobody has claimed it. {wrong}"
        await self._establish_motion()
        return ""

    async def make_safe(self) -> None:
        """For any axis, a running one too: what only matters when it is to stop."""
        await self._establish(objects.QUICK_STOP_OPTION, QUICK_STOP_RAMP_THEN_OFF)
        await self._establish(objects.QUICK_STOP_DECELERATION, self._tools.config.quick_stop_deceleration)

    async def claim(self) -> None:
        """For an adopted axis at standstill: what `configure` left out when it was found enabled.

        What can be written only in SWITCH_ON_DISABLED must be right already; else `NotReady`.
        """
        state = self._tools.drive.status.state
        if state is not PowerState.SWITCH_ON_DISABLED:
            wrong = await self._differences_that_need_power_off()
            if wrong:
                obstacle = DISABLE_TO_CLAIM.found(wrong)
                raise NotReady(
                    wrong, obstacles=(obstacle,), node=self._tools.node_id, axis=self._tools.number
                )
            await self._establish_motion()
        else:
            await self.configure(self._tools.drive.status.statusword)

    def wanted(self, config: AxisConfig) -> tuple[Wanted, ...]:
        """What the axis's objects should hold under a configuration, in the order of writing."""
        return tuple(wanted(config, self._tools.objects.profile, self._tools.number))

    async def apply(self, config: AxisConfig, establisher: Establisher) -> None:
        """Have the module hold another configuration; what needs SWITCH_ON_DISABLED is written first."""
        await self._establish_all(self.wanted(config), establisher)

    async def _establish_without_power(self) -> None:
        await self._establish(VELOCITY_DIMENSION, PULSES_PER_SECOND)
        rows = [one for one in self.wanted(self._tools.config) if one.needs_power_off]
        await self._establish_all(rows, self._establisher)

    async def _differences_that_need_power_off(self) -> str:
        rows = {
            one.parameter.key: one.value for one in self.wanted(self._tools.config) if one.needs_power_off
        }
        wrong: list[str] = []
        for (index, sub), value in {(VELOCITY_DIMENSION, 0): PULSES_PER_SECOND, **rows}.items():
            if self._has(index, sub):
                held = await self._read(index, sub)
                if held != value:
                    wrong.append(f"{index:04X}h is {held} instead of {value}")
        return f"Axis {self._tools.config.name}: {', '.join(wrong)}." if wrong else ""

    async def _establish_motion(self) -> None:
        rows = [one for one in self.wanted(self._tools.config) if not one.needs_power_off]
        safe = objects.QUICK_STOP_DECELERATION  # held since `make_safe`
        await self._establish_all([one for one in rows if one.parameter.index != safe], self._establisher)
        await self._establish(objects.POSITIONING_OPTION, 0)

    async def _establish_all(self, rows: Sequence[Wanted], establisher: Establisher) -> None:
        """One after the other, and of each of `PAIRS` first the one that makes room for the other."""
        waiting = {one.parameter.key: one for one in rows}
        for one in rows:
            key = one.parameter.key
            upper = PAIRS.get(key)
            if upper in waiting:
                held = await establisher.read(one.spec.address)
                if held is None or waiting[upper].value >= held:
                    other = waiting.pop(upper)
                    await establisher.hold(other.spec.address, other.value)
            if waiting.pop(key, None) is not None:
                await establisher.hold(one.spec.address, one.value)

    def _has(self, index: int, sub: int = 0) -> bool:
        return self._tools.objects.has(index, sub, self._tools.number)

    async def _read(self, index: int, sub: int = 0) -> int:
        address = self._tools.objects.address(index, sub, self._tools.number)
        return await self._tools.objects.read_int(address, priority=Priority.CONFIGURE)

    async def _establish(self, index: int, value: int, *, sub: int = 0) -> None:
        """Have the axis hold a value, where the model has the object."""
        if self._has(index, sub):
            await self._establisher.hold(self._tools.objects.address(index, sub, self._tools.number), value)


def is_running(statusword: int) -> bool:
    """Whether a statusword shows an axis that must not be touched: enabled, turning or stopping."""
    state = decode_state(statusword)
    return bool(statusword & Statusword.MOTOR_ACTIVITY) or state in (
        PowerState.OPERATION_ENABLED,
        PowerState.QUICK_STOP_ACTIVE,
        PowerState.FAULT_REACTION_ACTIVE,
    )
