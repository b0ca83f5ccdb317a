"""The fault panel of one simulated module: everything that can be done to it from outside, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Final, TypeAlias

from drivers.bus.faults import Faults
from drivers.bus.memory import MemoryBus
from drivers.errors import BadValue, NotReady
from drivers.obstacles import STANDING
from drivers.sim import snapshot
from drivers.sim.commands import CobId, CommandTable, Flag, OneOf, Real, Whole
from drivers.sim.module import SimulatedModule
from drivers.sim.motion.axis import SimulatedAxis
from drivers.sim.motion.travel import SwitchName
from drivers.sim.motion.troubles import Bridge
from drivers.sim.runner import SimulatedNode
from drivers.sim.snapshot import ModuleSnapshot
from drivers.sim.terminals import ANALOG, ANALOG_MAX, DIGITAL
from drivers.sim.wire_faults import WireFaults

COMMANDS: Final = CommandTable()
"""Every command of a `ModulePanel`, by name."""

AxisNumber: TypeAlias = Annotated[int, Whole("Number of the axis.")]
AxisOrAll: TypeAlias = Annotated[int | None, Whole("Number of the axis; all axes if left out.")]
Switch: TypeAlias = Annotated[
    SwitchName, OneOf("Which switch of the axis.", ("negative", "positive", "home"))
]
Identifier: TypeAlias = Annotated[int, CobId("Which frames on the wire, whoever sends them.")]
Count: TypeAlias = Annotated[int | None, Whole("How many frames; all from now on if left out.", 1, 1_000_000)]
Delay: TypeAlias = Annotated[float, Real("Seconds.", 0.0, 3600.0)]
Active: TypeAlias = Annotated[bool, Flag("True switches it on, false off.")]


class ModulePanel:
    """The hands on one module. Each command takes effect at once and stays until undone, or until `clear`.

    All commands check what they are given and raise `drivers.errors.BadValue`, which says what is allowed.
    They must be called in the thread of the module's event loop, while the module runs.
    """

    def __init__(self, number: int, node: SimulatedNode, port: MemoryBus, faults: Faults) -> None:
        """For the module that was made as node `number`; `port` is its own, `faults` those of its wire."""
        self.number = number
        self._node = node
        self._port = port
        self._wire = WireFaults(faults)

    def perform(self, command: str, arguments: Mapping[str, object]) -> None:
        """Do what a command of `COMMANDS` says, by name. Raises `BadValue`, and what the command raises."""
        COMMANDS.perform(self, command, arguments)

    def state(self) -> ModuleSnapshot:
        """What there is to see now."""
        return snapshot.take(self.number, self._node, self._wire.snapshot())

    def clear(self) -> None:
        """Undo everything: hands off, supply and connection back, and the module powered.

        Where the carriages stand, and what the module itself holds (a fault, parameters), stays.
        """
        self._wire.clear()
        self._node.faults.clear()
        self._port.plug()
        self._port.recover()
        self._node.apply(_mend_all)
        self.power_on()

    # --- mechanics ------------------------------------------------------------------------------------------

    @COMMANDS.enter
    def press_switch(self, axis: AxisNumber, switch: Switch) -> None:
        """Press a switch by hand."""
        self._axis(axis, lambda own, now: own.press_switch(switch, now))

    @COMMANDS.enter
    def release_switch(self, axis: AxisNumber, switch: Switch) -> None:
        """Take the hand off a switch; the carriage itself may still press it."""
        self._axis(axis, lambda own, now: own.release_switch(switch, now))

    @COMMANDS.enter
    def block(self, axis: AxisNumber) -> None:
        """Hold the carriage: the motor slips."""
        self._axis(axis, lambda own, now: own.block(now))

    @COMMANDS.enter
    def unblock(self, axis: AxisNumber) -> None:
        """Let the carriage go; the steps lost stay lost."""
        self._axis(axis, lambda own, now: own.unblock(now))

    @COMMANDS.enter
    def set_load(
        self,
        axis: AxisNumber,
        share: Annotated[float, Real("Share of the motor's torque; from 1 on it can't move.", 0.0, 1000.0)],
    ) -> None:
        """Load the mechanics; StallGuard sees it."""
        self._axis(axis, lambda own, now: own.load_torque(share, now))

    @COMMANDS.enter
    def stall(self, axis: AxisNumber) -> None:
        """Make the moving motor stall now. Raises `NotReady` where it stands."""

        def stall(own: SimulatedAxis, now: float) -> None:
            if not own.moving:
                raise NotReady(
                    f"the motor of axis {axis} stands, so it can't stall",
                    obstacles=(STANDING.found("The motor stands."),),
                    node=self.number,
                    axis=axis,
                )
            own.stall(now)

        self._axis(axis, stall)

    # --- electrics ------------------------------------------------------------------------------------------

    @COMMANDS.enter
    def cut_supply(self, axis: AxisOrAll = None) -> None:
        """Take the motor supply away: undervoltage. The module's logic lives on."""
        self._axes(axis, lambda own, now: own.supply(0.0, now))

    @COMMANDS.enter
    def restore_supply(self, axis: AxisOrAll = None) -> None:
        """Give the motor supply back, with the voltage that it had at first."""
        self._axes(axis, lambda own, now: own.supply(own.settings.supply_voltage, now))

    @COMMANDS.enter
    def set_supply(self, volts: Annotated[float, Real("Volts.", 0.0, 100.0)], axis: AxisOrAll = None) -> None:
        """Set the voltage of the motor supply."""
        self._axes(axis, lambda own, now: own.supply(volts, now))

    @COMMANDS.enter
    def set_temperature(
        self, axis: AxisNumber, celsius: Annotated[float, Real("Degrees Celsius.", -40.0, 250.0)]
    ) -> None:
        """Set the temperature of the motor driver."""
        self._axis(axis, lambda own, now: own.temperature(celsius, now))

    @COMMANDS.enter
    def short(
        self,
        axis: AxisNumber,
        bridge: Annotated[Bridge, OneOf("Where: a bridge, or the high side.", ("a", "b", "high"))],
    ) -> None:
        """Short-circuit the motor driver."""
        self._axis(axis, lambda own, now: own.short(bridge, now))

    @COMMANDS.enter
    def open_load(
        self, axis: AxisNumber, bridge: Annotated[Bridge, OneOf("Which coil's bridge.", ("a", "b"))]
    ) -> None:
        """Take a wire of the motor off."""
        self._axis(axis, lambda own, now: own.open_load(bridge, now))

    @COMMANDS.enter
    def mend(self, axis: AxisNumber) -> None:
        """Undo every short circuit and open load of an axis."""
        self._axis(axis, lambda own, now: own.mend(now))

    @COMMANDS.enter
    def set_shutdown_input(self, active: Active) -> None:
        """Open the module's shutdown switch (its enable signal is gone), or close it."""
        self._node.apply(lambda module, now: module.shutdown_switch(active, now))

    @COMMANDS.enter
    def set_digital_input(
        self,
        terminal: Annotated[int, Whole("Number of the digital terminal.", 0, DIGITAL - 1)],
        level: Annotated[bool, Flag("True = high.")],
    ) -> None:
        """Put a level on a digital terminal."""
        self._node.apply(lambda module, _now: module.terminals.apply(terminal, level))

    @COMMANDS.enter
    def set_analog_input(
        self,
        terminal: Annotated[int, Whole("Number of the analog input.", 0, ANALOG - 1)],
        value: Annotated[int, Whole("What the module reads.", 0, ANALOG_MAX)],
    ) -> None:
        """Put a voltage on an analog input."""
        self._node.apply(lambda module, _now: module.terminals.set_analog(terminal, value))

    # --- the module as a whole ------------------------------------------------------------------------------

    @COMMANDS.enter
    def power_off(self) -> None:
        """Take the whole module's supply away, at once."""
        self._node.power_off()

    @COMMANDS.enter
    def power_on(self) -> None:
        """Give the whole module its supply; it boots up, unless it had it."""
        if not self._node.module.powered:
            self._node.power_on()

    @COMMANDS.enter
    def power_cycle(self) -> None:
        """Power off and on in one moment; what is not stored is lost."""
        self._node.power_cycle()

    @COMMANDS.enter
    def report_error(
        self,
        code: Annotated[int, Whole("Emergency error code, e.g. 33040 for 8110h.", 1, 0xFFFF)],
        detail: Annotated[int, Whole("Additional byte 1.", 0, 0xFF)] = 0,
    ) -> None:
        """Have the module send an EMCY of its own for an error that is over at once."""
        self._node.report(code, detail)

    # --- its communication ----------------------------------------------------------------------------------

    @COMMANDS.enter
    def bus_off(self) -> None:
        """Its CAN controller goes bus-off."""
        self._port.bus_off()

    @COMMANDS.enter
    def recover_bus(self) -> None:
        """Its CAN controller comes back from bus-off."""
        self._port.recover()

    @COMMANDS.enter
    def unplug(self) -> None:
        """Take the bus cable off; the module runs on alone."""
        self._port.unplug()

    @COMMANDS.enter
    def plug(self) -> None:
        """Put the bus cable back."""
        self._port.plug()

    @COMMANDS.enter
    def set_silent(self, active: Active) -> None:
        """Send nothing, but hear and obey."""
        self._node.faults.silent = active

    @COMMANDS.enter
    def set_deaf(self, active: Active) -> None:
        """Hear nothing, but send what is due."""
        self._node.faults.deaf = active

    @COMMANDS.enter
    def set_no_boot_up(self, active: Active) -> None:
        """Leave the boot-up message out."""
        self._node.faults.no_boot_up = active

    @COMMANDS.enter
    def set_sdo_delay(self, seconds: Delay) -> None:
        """Answer SDOs late; 0 = in time."""
        self._node.faults.sdo_delay = seconds

    @COMMANDS.enter
    def set_sdo_mute(self, active: Active) -> None:
        """Never answer an SDO, though it is carried out."""
        self._node.faults.sdo_mute = active

    # --- frames on the wire ---------------------------------------------------------------------------------

    @COMMANDS.enter
    def drop_frames(self, cob_id: Identifier, count: Count = None) -> None:
        """Lose frames."""
        self._wire.drop(cob_id, count)

    @COMMANDS.enter
    def delay_frames(
        self,
        cob_id: Identifier,
        seconds: Annotated[float, Real("Seconds.", 0.000_001, 3600.0)],
        count: Count = None,
    ) -> None:
        """Let frames arrive late; others overtake them."""
        self._wire.delay(cob_id, seconds, count)

    @COMMANDS.enter
    def duplicate_frames(self, cob_id: Identifier, count: Count = None) -> None:
        """Let frames arrive twice."""
        self._wire.duplicate(cob_id, count)

    @COMMANDS.enter
    def corrupt_frames(
        self,
        cob_id: Identifier,
        byte: Annotated[int, Whole("Which byte; frames without it pass.", 0, 7)] = 0,
        bits: Annotated[int, Whole("Which of its bits are flipped.", 1, 0xFF)] = 0xFF,
        count: Count = None,
    ) -> None:
        """Flip bits in frames."""
        self._wire.corrupt(cob_id, byte, bits, count)

    @COMMANDS.enter
    def truncate_frames(
        self,
        cob_id: Identifier,
        length: Annotated[int, Whole("Bytes that are left; shorter frames pass.", 0, 7)],
        count: Count = None,
    ) -> None:
        """Cut frames off."""
        self._wire.truncate(cob_id, length, count)

    @COMMANDS.enter
    def end_wire_faults(self) -> None:
        """Let all frames pass that this panel dropped, delayed or changed."""
        self._wire.clear()

    # --- inside ---------------------------------------------------------------------------------------------

    def _axis(self, axis: int, change: Callable[[SimulatedAxis, float], None]) -> None:
        axes = self._node.module.axes
        if axis >= len(axes):
            raise BadValue(
                f"axis must be from 0 to {len(axes) - 1}, not {axis}", hint=f"Node {self.number} has no more."
            )
        self._node.apply(lambda module, now: change(module.axes[axis], now))

    def _axes(self, axis: int | None, change: Callable[[SimulatedAxis, float], None]) -> None:
        numbers = range(len(self._node.module.axes)) if axis is None else (axis,)
        for number in numbers:
            self._axis(number, change)


def _mend_all(module: SimulatedModule, now: float) -> None:
    for axis in module.axes:
        for switch in axis.travel.pressed:
            axis.release_switch(switch, now)
        axis.unblock(now)
        axis.load_torque(axis.settings.load, now)
        axis.mend(now)
        axis.supply(axis.settings.supply_voltage, now)
        axis.temperature(axis.settings.temperature, now)
    module.shutdown_switch(False, now)
    for terminal in range(DIGITAL):
        module.terminals.apply(terminal, False)
    for terminal in range(ANALOG):
        module.terminals.set_analog(terminal, 0)
