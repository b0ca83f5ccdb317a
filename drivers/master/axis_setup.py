"""How an axis is found, and what it must hold before it may be used: safe options, ramps that are not zero.

The order of the writes matters where the module compares two objects with each other (VSTOP with VSTART, one
software limit with the other).
"""

from __future__ import annotations

from typing import NamedTuple

from drivers.cia402 import objects
from drivers.cia402.power import PowerState, Statusword, decode_state
from drivers.errors import NotReady, Obstacle
from drivers.master.axis_tools import AxisTools
from drivers.master.config import INT32_MAX, INT32_MIN
from drivers.master.establish import Establisher
from drivers.master.sdo_client import Priority

MICROSTEPS = 0x2000
FULL_STEPS = 0x2001
SWITCH_PARAMETERS = 0x2005
START_VELOCITY = 0x2010
DECELERATION_D1 = 0x2013
DECELERATION_D2 = 0x2018
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
                obstacle = Obstacle("disable_first", wrong, "Disable the axis, then enable it again.")
                raise NotReady(
                    wrong, obstacles=(obstacle,), node=self._tools.node_id, axis=self._tools.number
                )
            await self._establish_motion()
        else:
            await self.configure(self._tools.drive.status.statusword)

    @property
    def _without_power(self) -> dict[int, int]:
        """What the module takes in SWITCH_ON_DISABLED only, and what must not change under a held motor.

        The manual lets 2000h and 2001h be written at any time (§4.2.1, §4.2.2), but they change what a step
        is.
        """
        config = self._tools.config
        wanted = {VELOCITY_DIMENSION: PULSES_PER_SECOND, SWITCH_PARAMETERS: config.switch_parameters}
        if config.gearing is not None:
            wanted[MICROSTEPS] = config.gearing.microstep_exponent
            wanted[FULL_STEPS] = config.gearing.full_steps
        return wanted

    async def _establish_without_power(self) -> None:
        for index, value in self._without_power.items():
            await self._establish(index, value)

    async def _differences_that_need_power_off(self) -> str:
        wrong: list[str] = []
        for index, value in self._without_power.items():
            if self._has(index):
                held = await self._read(index)
                if held != value:
                    wrong.append(f"{index:04X}h is {held} instead of {value}")
        return f"Axis {self._tools.config.name}: {', '.join(wrong)}." if wrong else ""

    async def _establish_motion(self) -> None:
        config = self._tools.config
        await self._establish(objects.POSITION_WINDOW, 0)
        await self._establish(objects.POSITION_WINDOW_TIME, 0)
        await self._establish_pair(
            (START_VELOCITY, 0, config.start_velocity), (objects.END_VELOCITY, 0, config.end_velocity)
        )
        for index in (DECELERATION_D1, DECELERATION_D2):
            await self._establish(index, config.deceleration)
        await self._establish(objects.PROFILE_VELOCITY, config.velocity)
        await self._establish(objects.PROFILE_ACCELERATION, config.acceleration)
        await self._establish(objects.PROFILE_DECELERATION, config.deceleration)
        await self._establish(objects.HOMING_SPEEDS, config.homing_fast, sub=1)
        await self._establish(objects.HOMING_SPEEDS, config.homing_slow, sub=2)
        await self._establish(objects.HOMING_ACCELERATION, config.homing_acceleration)
        await self._establish(objects.HOME_OFFSET, config.home_offset)
        low, high = config.soft_limits or (INT32_MIN, INT32_MAX)
        await self._establish_pair((objects.SOFTWARE_LIMIT, 1, low), (objects.SOFTWARE_LIMIT, 2, high))
        await self._establish(objects.POSITIONING_OPTION, 0)

    async def _establish_pair(self, lower: tuple[int, int, int], upper: tuple[int, int, int]) -> None:
        """Two objects of which the first must never pass the second, on the way either."""
        if not (self._has(lower[0], lower[1]) and self._has(upper[0], upper[1])):
            return
        held = await self._read(lower[0], lower[1])
        order = (lower, upper) if upper[2] < held else (upper, lower)
        for index, sub, value in order:
            await self._establish(index, value, sub=sub)

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
