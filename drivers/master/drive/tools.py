"""What every command of an axis works with, and the drive parameters that it already wrote."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.cia301.objects import Address
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, PowerState
from drivers.errors import AxisFault, ConfigurationRefused, MotionFailed, TransitionTimeout
from drivers.master.drive.drive import Drive
from drivers.master.ground.timing import Timing
from drivers.master.ground.where import AxisId, Where
from drivers.master.plan.configuration import AxisConfig
from drivers.master.sdo.client import Priority
from drivers.master.sdo.object_access import ObjectAccess
from drivers.master.seen.boot_log import Change
from drivers.master.seen.status import AxisStatus

Parameter = tuple[int, int]
"""Base index and sub-index."""


class DriveParameters:
    """Writes an axis's drive parameters by SDO, but only those that the module does not hold already."""

    def __init__(self, objects: ObjectAccess, axis: int) -> None:
        self._objects = objects
        self._axis = axis
        self._held: dict[Address, int] = {}
        self._owed: dict[Parameter, int] = {}
        """What the module is to hold again: a command needed something else there for a moment."""

    async def require(self, values: Mapping[Parameter, int]) -> None:
        """Have the module hold these values, and first whatever is still owed to it.

        Raises `BadValue`, `ConfigurationRefused`, `SdoError` or `BusError`.
        """
        await self.settle()
        for (index, sub), value in values.items():
            address = self._objects.address(index, sub, self._axis)
            if self._held.get(address) != value:
                self._held.pop(address, None)  # until confirmed, what it holds is unknown
                await self._objects.write(address, value, priority=Priority.CONTROL)
                self._held[address] = value

    async def lend(self, index: int, sub: int, value: int, *, owed: int) -> None:
        """Have the module hold `value` until `settle`, or the next command's `require`, brings `owed` back.

        Raises `BadValue`, `SdoError` or `BusError`.
        """
        self._owed[index, sub] = owed
        await self._objects.write(
            self._objects.address(index, sub, self._axis), value, priority=Priority.CONTROL
        )

    async def settle(self) -> None:
        """Bring back what is owed, read back. Raises `ConfigurationRefused`, `SdoError` or `BusError`."""
        for (index, sub), value in tuple(self._owed.items()):
            address = self._objects.address(index, sub, self._axis)
            await self._objects.write(address, value, priority=Priority.CONTROL)
            held = await self._objects.read_int(address, priority=Priority.CONTROL)
            if held != value:
                raise ConfigurationRefused(
                    f"{address} holds {held} though {value} was written.",
                    hint="Take the node in anew (POST boot) before anything moves.",
                    axis=self._axis,
                    index=address.index,
                    sub=sub,
                )
            self._owed.pop((index, sub), None)

    def changes(self, values: Mapping[Parameter, int]) -> tuple[Change, ...]:
        """What `require` would write now."""
        found: list[Change] = []
        for (index, sub), value in values.items():
            address = self._objects.address(index, sub, self._axis)
            old = self._held.get(address)
            if old != value:
                spec = self._objects.spec(address)
                found.append(Change(address, spec.name, self._axis, old, value, spec.unit))
        return tuple(found)

    def held(self, index: int, sub: int, otherwise: int) -> int:
        """What the module is known to hold; `otherwise` where that is unknown."""
        return self._held.get(self._objects.address(index, sub, self._axis), otherwise)

    def forget(self, address: Address | None = None) -> None:
        """The module may hold something else now: at one address, or (None) everywhere.

        In the latter case nothing is owed any more: it is compared with all that it must hold first.
        """
        if address is None:
            self._held.clear()
            self._owed.clear()
        else:
            self._held.pop(address, None)


class CurrentConfig:
    """The one configuration that an axis goes by. `Axis.go_by` replaces it, and nobody keeps a copy."""

    def __init__(self, config: AxisConfig) -> None:
        self.value = config


@dataclass(frozen=True, slots=True)
class AxisTools:
    """One axis's drive, objects, configuration and times."""

    node_id: int
    number: int
    current: CurrentConfig
    timing: Timing
    drive: Drive
    objects: ObjectAccess
    parameters: DriveParameters

    @property
    def config(self) -> AxisConfig:
        """The configuration that the axis goes by now; another may be set while it stands."""
        return self.current.value

    @property
    def id(self) -> AxisId:
        """Which axis they are of."""
        return AxisId(self.node_id, self.number)

    @property
    def where(self) -> Where:
        """`node` and `axis`, for an error."""
        return {"node": self.node_id, "axis": self.number}

    def require_enabled(self, status: AxisStatus) -> None:
        """Raise `AxisFault`, or `MotionFailed` where the drive left OPERATION_ENABLED otherwise."""
        if status.state is PowerState.OPERATION_ENABLED:
            return
        if status.state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
            raise self.fault(status)
        raise MotionFailed(
            f"Axis {self.config.name} left OPERATION_ENABLED during the motion; it is "
            f"{status.state or 'in no known state'} now.",
            hint="Look at the module's enable input and supply, then enable the axis again.",
            **self.where,
        )

    def fault(self, status: AxisStatus) -> AxisFault:
        """The error for a drive in FAULT, with what its active emergencies say."""
        causes = "; ".join(f"{e.title} ({e.code:04X}h)" for e in status.emergencies)
        remedies = " ".join(e.remedy for e in status.emergencies)
        return AxisFault(
            f"Axis {self.config.name} is in FAULT: {causes or 'no emergency names the cause'}.",
            hint=f"{remedies} Then reset the fault and enable the axis again.".strip(),
            **self.where,
        )

    async def enter_mode(self, mode: Mode, controlword: int = Controlword.ENABLE_OPERATION) -> None:
        """6060h by RPDO 1, and wait until 6061h follows. Raises `TransitionTimeout`.

        A halt that still holds a set point back is not released before mode 0 has discarded that.
        """
        drive = self.drive
        if drive.halted and not controlword & Controlword.HALT:
            await self.enter_mode(Mode.NO_MODE, Controlword.ENABLE_OPERATION | Controlword.HALT)
        if drive.commanded_mode is mode and drive.status.mode is mode and drive.controlword == controlword:
            return

        def command() -> None:
            drive.command(controlword, mode)

        def command_again() -> None:
            enables = controlword & 0x8F == Controlword.ENABLE_OPERATION
            if drive.energised or not enables:  # one that was switched off meanwhile must stay so
                command()

        command()
        if not await drive.until(lambda s: s.mode is mode, self.timing.mode_change, resend=command_again):
            raise TransitionTimeout(
                f"Axis {self.config.name} did not enter mode {mode.short} in {self.timing.mode_change} s.",
                **self.where,
            )
