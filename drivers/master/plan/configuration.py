"""What a person configures: the bus's nodes, their axes, and how each axis should move.

Positions are microsteps ("steps"), velocities steps/s, accelerations steps/s2: the module's pps and pps/s
while 208Ch is 181 (manual §4.2.19). Everything is checked when it is made, before a frame is sent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

from drivers.errors import BadValue, BrokenRule, RulesBroken
from drivers.master.plan.axis_rules import HIGHEST_RATE, INT32_MAX, INT32_MIN, broken_gearing, broken_rules
from drivers.master.plan.gearing import STEPS, Gearing, exact, relatives

__all__ = ["HIGHEST_RATE", "INT32_MAX", "INT32_MIN", "AxisConfig", "NetworkConfig", "NodeConfig"]


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise BadValue(message, hint="Correct the configuration of the axis or node named in the message.")


class Limits(NamedTuple):
    """Lowest and highest target, steps."""

    lower: int
    upper: int


@dataclass(frozen=True, slots=True)
class AxisConfig:
    """How one axis moves when a command leaves something out, and what the module must hold before it may."""

    name: str
    """Unique on its node; not a bare number."""
    unit: str = "steps"
    """The user's unit of length or angle, e.g. ``mm``."""
    steps_per_unit: float | Fraction = Fraction(1)
    """Steps in one `unit`, taken exactly as written; negative turns the direction around. With `gearing` it
    follows from that.
    """
    gearing: Gearing | None = None
    """Motor, gear and pitch; 2000h and 2001h are written to match. None: `steps_per_unit` says it all, and
    the module keeps its resolution.
    """
    units: Mapping[str, Fraction] = field(init=False, repr=False, compare=False)
    """Steps in one of each unit that the axis can be commanded in: `unit`, and what follows from it."""
    velocity: int = 51_200
    """6081h, steps/s, 1..16777215: one turn a second of a 200-step motor at 256 microsteps."""
    acceleration: int = 102_400
    """6083h, steps/s2, 1..16777215. Also decelerates in profile velocity (manual §6.1.14)."""
    deceleration: int = 102_400
    """6084h, steps/s2, 1..16777215."""
    max_velocity: int = HIGHEST_RATE
    """steps/s: a command above it is refused."""
    max_acceleration: int = HIGHEST_RATE
    """steps/s2: a command whose acceleration or deceleration is above it is refused; a quick stop is not."""
    quick_stop_deceleration: int = 512_000
    """6085h, steps/s2, 1..16777215: quick stop and fault reaction."""
    start_velocity: int = 0
    """2010h VSTART, steps/s."""
    end_velocity: int = 10
    """6082h VSTOP, steps/s, at least 10 and at least `start_velocity` (manual §1.5)."""
    ramp_a1: int = 0
    """2011h, steps/s2: acceleration up to `ramp_v1`."""
    ramp_v1: int = 0
    """2012h, steps/s: with `ramp_v2` 0 as well the ramp is a trapezoid (manual §1.5)."""
    ramp_d1: int | None = None
    """2013h, steps/s2: deceleration below `ramp_v1`; never 0. None: `deceleration`."""
    ramp_a2: int = 0
    """2016h, steps/s2: acceleration from `ramp_v1` to `ramp_v2`."""
    ramp_v2: int = 0
    """2017h, steps/s."""
    ramp_d2: int | None = None
    """2018h, steps/s2: deceleration from `ramp_v2` to `ramp_v1`; never 0. None: `deceleration`."""
    ramp_wait: int | None = None
    """2015h, 32 us each: rest at standstill before the next ramp. None: as the module holds it, like every
    None below.
    """
    homing_method: int = 35
    """6098h, used when a home command names none. 35 takes the present position as zero and doesn't move."""
    homing_fast: int = 25_600
    """6099h:1, steps/s."""
    homing_slow: int = 5_120
    """6099h:2, steps/s."""
    homing_acceleration: int = 102_400
    """609Ah, steps/s2."""
    home_offset: int = 0
    """607Ch, steps."""
    soft_limits: tuple[int, int] | None = None
    """607Dh: lowest and highest target, steps relative to machine home; None: the whole range."""
    switch_parameters: int = 0
    """2005h, bits of manual table 62: 0 uses both limit switches, 3 ignores them (none wired)."""
    position_tolerance: int = 0
    """How far from the target, in steps, a finished move may read; above 0 only with an encoder."""
    position_window: int = 0
    """6067h, steps: how near the encoder must be to the target; 0: the demand has reached it."""
    position_window_time: int = 0
    """6068h, ms in the window before the target counts as reached."""
    following_error_window: int | None = None
    """6065h, steps; 0: never."""
    run_current: int | None = None
    """2003h, 0..255 for 0..100 % of the driver's current."""
    standby_current: int | None = None
    """2004h, 0..255 for 0..100 % of the driver's current."""
    standby_delay: int | None = None
    """2089h, 10 ms each: standstill before the standby current."""
    encoder: bool | None = None
    """606Ah: whether positions come from the encoder."""
    encoder_resolution: int | None = None
    """608Fh:1, increments in a motor turn."""
    encoder_null_polarity: int | None = None
    """200Bh:1, 0 or 1."""
    encoder_direction: int | None = None
    """200Bh:2, 1: opposite to the motor."""
    encoder_initialize: int | None = None
    """200Bh:3, 1: positions begin with the encoder's."""
    brake_apply_current: int | None = None
    """200Ch:1, 0..255."""
    brake_release_current: int | None = None
    """200Ch:2, 0..255; 0 in both: no brake."""
    brake_apply_delay: int | None = None
    """2002h:1, ms from applying the brake to power off."""
    brake_release_delay: int | None = None
    """2002h:2, ms from releasing the brake to OPERATION_ENABLED."""
    enable_delay: int | None = None
    """200Ah, ms from power on to releasing the brake."""
    require_homing: bool = False
    """Whether absolute moves are refused until the axis was homed."""

    def __post_init__(self) -> None:
        broken = list(broken_rules(self))
        if self.gearing is not None:
            broken += broken_gearing(self.gearing)
        if not broken:
            broken += self._settle_units()
        if broken:
            raise RulesBroken(f"Axis {self.name!r}", tuple(broken))

    def _settle_units(self) -> Iterator[BrokenRule]:
        known = {STEPS: Fraction(1)}
        per_unit = self.steps_per_unit
        if not self.unit.strip():
            yield BrokenRule("unit", "unit_is_a_word", "The unit must not be empty.")
        elif self.gearing is not None:
            known |= self.gearing.units
            if self.unit in known:
                per_unit = known[self.unit]
            else:
                yield BrokenRule(
                    "unit",
                    "unit_follows_from_gearing",
                    f"The unit {self.unit} does not follow from the gearing; {', '.join(known)} do "
                    "(a length needs a pitch).",
                )
        elif math.isfinite(per_unit) and 1e-9 <= abs(per_unit) < 1e12:
            per_unit = exact(per_unit)
            known = relatives(self.unit, per_unit) | known
        else:
            yield BrokenRule(
                "steps_per_unit",
                "range_of_steps_per_unit",
                "steps_per_unit must be a finite number from 1e-9 to 1e12, negative or not.",
            )
        object.__setattr__(self, "steps_per_unit", per_unit)
        object.__setattr__(self, "units", known)

    @property
    def d1(self) -> int:
        """2013h, steps/s2."""
        return self.deceleration if self.ramp_d1 is None else self.ramp_d1

    @property
    def d2(self) -> int:
        """2018h, steps/s2."""
        return self.deceleration if self.ramp_d2 is None else self.ramp_d2

    @property
    def module_limits(self) -> Limits:
        """607Dh, steps: `soft_limits`, or the whole range."""
        return Limits(INT32_MIN, INT32_MAX) if self.soft_limits is None else Limits(*self.soft_limits)

    def check_rates(
        self, *, velocity: int | None = None, acceleration: int | None = None, deceleration: int | None = None
    ) -> None:
        """Hold what a command asks for (without direction, steps/s and steps/s2) against the maxima.

        Raises `RulesBroken`.
        """
        asked = (
            ("velocity", velocity, "max_velocity", self.max_velocity, "steps/s"),
            ("acceleration", acceleration, "max_acceleration", self.max_acceleration, "steps/s2"),
            ("deceleration", deceleration, "max_acceleration", self.max_acceleration, "steps/s2"),
        )
        broken = tuple(
            BrokenRule(
                name,
                rule,
                f"{name} must be at most {rule}, which is {highest} {unit} here, not {value} {unit}.",
            )
            for name, value, rule, highest, unit in asked
            if value is not None and value > highest
        )
        if broken:
            raise RulesBroken(f"Axis {self.name!r}", broken)

    @property
    def target_range(self) -> tuple[int, int]:
        """The targets that the drive takes: `soft_limits` corrected by `home_offset` (manual §6.1.11)."""
        if self.soft_limits is None:
            return INT32_MIN, INT32_MAX
        low, high = self.soft_limits
        return max(INT32_MIN, low - self.home_offset), min(INT32_MAX, high - self.home_offset)


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """One module on the bus."""

    node_id: int
    """1..127, unique on the bus."""
    name: str
    """Unique on the bus; not a bare number."""
    model: str = "TMCM-3216"
    """A model of the catalog."""
    axes: tuple[AxisConfig, ...] = ()
    """At most as many as the model has; what is missing gets defaults and the names ``axis0``, ``axis1``...
    """
    analog_full_scale: float | None = None
    """Volts at which an analog input reads its highest value; None: unknown, the manual gives no scale."""

    def __post_init__(self) -> None:
        _require(
            1 <= self.node_id <= 127, f"Node {self.name!r}: the node ID must be 1..127, not {self.node_id}."
        )
        _require(bool(self.name.strip()), f"Node {self.node_id} needs a name.")
        _require(not self.name.strip().isdecimal(), f"Node {self.name!r}: a name must not be a bare number.")
        volts = self.analog_full_scale
        _require(
            volts is None or 0 < volts <= 1000, f"Node {self.name!r}: analog_full_scale must be 0..1000 V."
        )
        names = [axis.name for axis in self.axes]
        _require(len(set(names)) == len(names), f"Node {self.name!r}: two axes have the same name.")


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """One bus: its nodes and the master's own settings."""

    nodes: tuple[NodeConfig, ...] = field(default=())
    master_node_id: int = 127
    """The ID under which the master's heartbeat goes out; no node may have it."""
    heartbeat_ms: int = 100
    """Period of the master's heartbeat; at most a third of `consumer_ms`."""
    consumer_ms: int = 500
    """1016h:1: how long a module waits for the master's heartbeat before it stops its motors."""
    node_heartbeat_ms: int = 500
    """1017h: period of each node's heartbeat."""
    allow_unverified_failsafe: bool = False
    """Let axes be enabled on a node whose 1029h could not be set, so that nothing stops it when we die."""
    sender_process: bool = True
    """Whether the set points of a trajectory come from a process of its own where the bus can be opened
    twice; else from the event loop.
    """

    def __post_init__(self) -> None:
        _require(1 <= self.master_node_id <= 127, "The master's node ID must be 1..127.")
        ids = [node.node_id for node in self.nodes]
        names = [node.name for node in self.nodes]
        _require(len(set(ids)) == len(ids), "Two configured nodes have the same ID.")
        _require(len(set(names)) == len(names), "Two configured nodes have the same name.")
        _require(self.master_node_id not in ids, "A configured node has the master's own ID.")
        _require(self.heartbeat_ms >= 10, "heartbeat_ms must be at least 10.")
        _require(
            3 * self.heartbeat_ms <= self.consumer_ms <= 65_535,
            "consumer_ms must be at least three times heartbeat_ms, and at most 65535.",
        )
        _require(10 <= self.node_heartbeat_ms <= 65_535, "node_heartbeat_ms must be 10..65535.")
