"""Changing the settings of axes while the service runs: written, read back, kept, and only then gone by.

All or nothing over the axes. Whatever goes wrong, what was written is taken back and the old settings stay.
A stop is never held up: it needs nothing of what is being written.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence

from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.errors import CanaxisError, NodeAway, NotReady
from drivers.master.axis.axis import Axis
from drivers.master.axis.commands import AxisCommand
from drivers.master.axis.readiness import obstacles, refusal
from drivers.master.link.holding import Establisher
from drivers.master.plan.axis_parameters import Wanted, check_ranges, wanted
from drivers.master.plan.configuration import AxisConfig
from drivers.master.sdo.object_access import ObjectAccess
from drivers.master.seen.boot_log import Change
from drivers.obstacles import DISABLE_TO_CHANGE


class Trial(Establisher):
    """Writes one axis's objects so that it can all be taken back."""

    def __init__(self, node_id: int, objects: ObjectAccess) -> None:
        self.changes: list[Change] = []
        self._before: list[tuple[Address, int | None]] = []
        super().__init__(node_id, objects, self)

    def compared(self) -> None:
        """An object was read."""

    def wrote(self, change: Change) -> None:
        """An object was written and read back."""
        self.changes.append(change)

    async def hold(self, address: Address, value: int) -> None:
        """See `Establisher.hold`."""
        held = await self.read(address)
        if held != value:
            self._before.append((address, held))  # from now on it may hold either
            await self.write(address, value)
            await self.confirm(address, value, held)

    async def take_back(self) -> None:
        """Write what was held before, the last first.

        Raises `ConfigurationRefused`, `SdoError`, `BusError`.
        """
        while self._before:
            address, held = self._before[-1]
            if held is not None:
                await self.write(address, held)
                await self.confirm(address, held, held)
            self._before.pop()


async def reconfigure(
    configs: Mapping[Axis, AxisConfig], keep: Callable[[], Awaitable[None]]
) -> Mapping[Axis, tuple[Change, ...]]:
    """Have modules hold other settings, `keep` them, then go by them; returns what was written.

    Raises, before anything is written, `RulesBroken`, `AxisBusy` or `NotReady` (an axis moves or holds a
    motion; or must be disabled for what is to change), `NodeAway`, `BusDown`; then `ConfigurationRefused`,
    `SdoError`, or what `keep` raises, with everything taken back.
    """
    for axis, config in configs.items():
        check_ranges(config, axis.node.profile, axis.number)
        _check_permission(axis, config)
    lives = {axis: axis.lives for axis in configs}
    trials: dict[Axis, Trial] = {}
    for axis in configs:
        axis.configuring = True
    try:
        for axis, config in configs.items():
            trials[axis] = Trial(axis.node.node_id, axis.node.objects)
            await axis.setup.apply(config, trials[axis])
        for axis in configs:
            _check_alive(axis, lives[axis])
        await keep()
        for axis, config in configs.items():
            if axis.lives != lives[axis]:
                axis.unsettled = "Its module started anew while other settings were written."
            axis.go_by(config)
    except BaseException:
        for axis, trial in reversed(trials.items()):
            await _take_back(axis, trial)
        raise
    finally:
        for axis in configs:
            axis.configuring = False
    return {axis: tuple(trial.changes) for axis, trial in trials.items()}


def changed_without_power(axis: Axis, config: AxisConfig) -> Sequence[Wanted]:
    """What differs from the present settings, and is written in SWITCH_ON_DISABLED only."""
    profile = axis.node.profile
    now = {one.spec.address: one.value for one in wanted(axis.config, profile, axis.number)}
    return [
        one
        for one in wanted(config, profile, axis.number)
        if one.needs_power_off and now.get(one.spec.address) != one.value
    ]


def _check_permission(axis: Axis, config: AxisConfig) -> None:
    if found := obstacles(axis, AxisCommand.SETTINGS):
        raise refusal(axis, AxisCommand.SETTINGS, found)
    if axis.status.state is PowerState.SWITCH_ON_DISABLED:
        return
    settings = [one.parameter.setting for one in changed_without_power(axis, config)]
    if config.units != axis.config.units or config.unit != axis.config.unit:
        settings.append("unit")
    if settings:
        names = ", ".join(dict.fromkeys(settings))
        obstacle = DISABLE_TO_CHANGE.found(
            f"Axis {axis.name} is {axis.status.state or 'in no known state'}; {names} can be changed only "
            "while it is switched off (SWITCH_ON_DISABLED)."
        )
        raise NotReady(obstacle.message, obstacles=(obstacle,), node=axis.node.node_id, axis=axis.number)


def _check_alive(axis: Axis, lives: int) -> None:
    if axis.lives != lives:
        raise NodeAway(
            f"Node {axis.node.name} was lost or started anew while settings were written; the old ones stay.",
            hint="Wait until it is operational, then send them again.",
            node=axis.node.node_id,
            axis=axis.number,
        )


async def _take_back(axis: Axis, trial: Trial) -> None:
    """As far as the module lets us; else nothing moves before it was compared with all that it must hold."""
    try:
        await trial.take_back()
    except CanaxisError as error:
        axis.unsettled = (
            f"Settings were refused half-way and could not be taken back, so its module may hold either: "
            f"{error.message}"
        )
