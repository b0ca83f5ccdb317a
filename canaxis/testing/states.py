"""What a simulated module looks like from outside at one moment: switches, carriages, supply, faults."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class AxisState:
    """One axis: where its carriage truly is, and what hands do to it."""

    axis: int
    state: str
    """Of its drive: `switch_on_disabled`, `operation_enabled`, `fault` ..."""
    mode: str
    """Short name of its mode of operation, e.g. ``pp``."""
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
class WireFault:
    """One rule on the wire."""

    kind: str
    """``drop``, ``delay``, ``duplicate``, ``corrupt`` or ``truncate``."""
    cob_id: int
    hits: int
    """How many frames it struck so far."""
    remaining: int | None
    """How many more it will strike; None = all."""


@dataclass(frozen=True, slots=True)
class WatchState:
    """Its watch over the master's heartbeat (1016h:1). Times are of `ModuleState.clock`."""

    node: int | None
    """Whom it watches; None = nobody."""
    heard_at: float | None
    """When the last heartbeat came; None = none since the watch was set, which isn't armed then."""
    lost_at: float | None
    """When it was found missing and EMCY 8130h was due; None unless it is missing still."""


@dataclass(frozen=True, slots=True)
class ModuleState:
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
    bus: str
    """Of its CAN controller: `active`, `bus_off` ..."""
    error_register: int
    """1001h."""
    watch: WatchState
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
    wire_faults: tuple[WireFault, ...]
    axes: tuple[AxisState, ...]
