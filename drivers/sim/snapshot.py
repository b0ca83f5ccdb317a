"""What a simulated module looks like from outside at one moment: switches, carriages, supply, faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from drivers.bus.base import BusState
from drivers.cia301.objects import Address
from drivers.cia402 import objects
from drivers.cia402.power import PowerState
from drivers.sim.module import SimulatedModule
from drivers.sim.motion.axis import SimulatedAxis
from drivers.sim.runner import SimulatedNode
from drivers.sim.terminals import ANALOG, ANALOG_INPUTS, DIGITAL


@dataclass(frozen=True, slots=True)
class AxisSnapshot:
    """One axis: where its carriage truly is, and what hands do to it."""

    axis: int
    state: PowerState
    mode: str
    """Short name of the mode that 6061h shows, e.g. ``pp``."""
    place: float
    """Of the carriage, microsteps on the travel's own scale, which homing never changes."""
    position: int
    """6064h, microsteps: what the module believes."""
    velocity: float
    """Of the motor, microsteps/s."""
    moving: bool
    switches: tuple[str, ...]
    """Active now, after polarity, as 60FDh shows them: ``negative``, ``positive``, ``home``."""
    pressed: tuple[str, ...]
    """Pressed by hand."""
    blocked: bool
    load: float
    """Share of the motor's torque."""
    supply_voltage: float
    """Volts, of the motor supply."""
    temperature: float
    """Of the motor driver, degrees Celsius."""
    shorts: tuple[str, ...]
    open_loads: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class WireFaultSnapshot:
    """One rule on the wire."""

    kind: str
    """``drop``, ``delay``, ``duplicate``, ``corrupt`` or ``truncate``."""
    cob_id: int
    hits: int
    """How many frames it struck so far."""
    remaining: int | None
    """How many more it will strike; None = all."""


@dataclass(frozen=True, slots=True)
class WatchSnapshot:
    """Its watch over the master's heartbeat (1016h:1). Times are of `ModuleSnapshot.clock`."""

    node: int | None
    """Whom it watches; None = nobody."""
    heard_at: float | None
    """When the last heartbeat came; None = none since the watch was set, which isn't armed then."""
    lost_at: float | None
    """When it was found missing and EMCY 8130h was due; None unless it is missing still."""


@dataclass(frozen=True, slots=True)
class ModuleSnapshot:
    """A whole module."""

    clock: float = field(compare=False)
    """When this was taken: seconds on the simulator's own monotonic clock. Two that differ in this alone are
    equal.
    """

    node: int
    """The node ID that it was made with; it is known by this one whatever LSS does."""
    node_id: int | None
    """The node ID in force; None = unconfigured."""
    powered: bool
    nmt_state: str
    bus: BusState
    """Of its CAN controller."""
    error_register: int
    """1001h."""
    watch: WatchSnapshot
    silent: bool
    deaf: bool
    no_boot_up: bool
    sdo_mute: bool
    sdo_delay: float
    """Seconds."""
    shutdown_input: bool
    digital_levels: tuple[bool, ...]
    """The level on each digital terminal, whoever drives it."""
    digital_outputs: tuple[bool, ...]
    """Whether the module drives the terminal high."""
    analog_inputs: tuple[int, ...]
    wire_faults: tuple[WireFaultSnapshot, ...]
    axes: tuple[AxisSnapshot, ...]


def take(number: int, node: SimulatedNode, wire_faults: Sequence[WireFaultSnapshot]) -> ModuleSnapshot:
    """What there is to see now of the module that was made as node `number`."""

    def look(module: SimulatedModule, now: float) -> ModuleSnapshot:
        terminals, faults = module.terminals, node.faults
        watch = module.watch
        return ModuleSnapshot(
            clock=now,
            node=number,
            node_id=module.node_id,
            powered=module.powered,
            nmt_state=module.nmt_state.name.lower(),
            bus=node.bus.state,
            error_register=module.error_register,
            watch=WatchSnapshot(watch.node, watch.heard_at, watch.lost_at),
            silent=faults.silent,
            deaf=faults.deaf,
            no_boot_up=faults.no_boot_up,
            sdo_mute=faults.sdo_mute,
            sdo_delay=faults.sdo_delay,
            shutdown_input=any(axis.conditions.shutdown for axis in module.axes),
            digital_levels=tuple(terminals.level(terminal) for terminal in range(DIGITAL)),
            digital_outputs=tuple(terminals.output(terminal) for terminal in range(DIGITAL)),
            analog_inputs=tuple(_analog(module, terminal, now) for terminal in range(ANALOG)),
            wire_faults=tuple(wire_faults),
            axes=tuple(_axis(axis, now) for axis in module.axes),
        )

    return node.apply(look)


def _analog(module: SimulatedModule, terminal: int, now: float) -> int:
    return int.from_bytes(module.dictionary.read(Address(ANALOG_INPUTS, terminal + 1), now), "little")


def _axis(axis: SimulatedAxis, now: float) -> AxisSnapshot:
    axis.advance(now)
    inputs = axis.read(objects.DIGITAL_INPUTS, 0, now) or 0
    bits = objects.DigitalInput
    named = (
        ("negative", bits.NEGATIVE_LIMIT),
        ("positive", bits.POSITIVE_LIMIT),
        ("home", bits.HOME_SWITCH),
    )
    return AxisSnapshot(
        axis=axis.axis,
        state=axis.state,
        mode=axis.mode.short,
        place=axis.motor.place(now),
        position=axis.read(objects.POSITION, 0, now) or 0,
        velocity=axis.motor.velocity(now),
        moving=axis.moving,
        switches=tuple(name for name, bit in named if inputs & bit),
        pressed=tuple(sorted(axis.travel.pressed)),
        blocked=axis.blocked,
        load=axis.supervision.load,
        supply_voltage=axis.conditions.voltage,
        temperature=axis.conditions.temperature,
        shorts=tuple(sorted(axis.conditions.shorts)),
        open_loads=tuple(sorted(axis.conditions.open_loads)),
    )
