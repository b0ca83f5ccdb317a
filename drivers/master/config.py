"""What a person configures: the bus's nodes, their axes, and how each axis should move.

Positions are microsteps ("steps"), velocities steps/s, accelerations steps/s2: the module's pps and pps/s
while 208Ch is 181 (manual §4.2.19). Everything is checked when it is made, before a frame is sent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from drivers.errors import BadValue
from drivers.master.gearing import STEPS, Gearing, exact, relatives

INT32_MIN = -(2**31)
INT32_MAX = 2**31 - 1
HIGHEST_RATE = 16_777_215
"""The highest velocity or acceleration that the ramp generator's registers take (ranges in manual §4.2.11
ff.).
"""

_LARGEST_TERM = 10**15
"""Of a gear's or a pitch's ratio, so that numbers stay handy."""


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise BadValue(message, hint="Correct the configuration of the axis or node named in the message.")


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
    quick_stop_deceleration: int = 512_000
    """6085h, steps/s2, 1..16777215: quick stop and fault reaction."""
    start_velocity: int = 0
    """2010h VSTART, steps/s."""
    end_velocity: int = 10
    """6082h VSTOP, steps/s, at least 10 and at least `start_velocity` (manual §1.5)."""
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
    require_homing: bool = False
    """Whether absolute moves are refused until the axis was homed."""

    def __post_init__(self) -> None:
        where = f"Axis {self.name!r}"
        _require(bool(self.name.strip()), "An axis needs a name.")
        _require(not self.name.strip().isdecimal(), f"{where}: a name must not be a bare number.")
        _require(bool(self.unit.strip()), f"{where}: the unit must not be empty.")
        self._settle_units(where)
        for name in (
            "velocity", "acceleration", "deceleration", "quick_stop_deceleration",
            "homing_fast", "homing_slow", "homing_acceleration",
        ):  # fmt: skip
            value: int = getattr(self, name)
            _require(1 <= value <= HIGHEST_RATE, f"{where}: {name} must be 1..{HIGHEST_RATE}, not {value}.")
        _require(
            0 <= self.start_velocity <= self.end_velocity <= HIGHEST_RATE and self.end_velocity >= 10,
            f"{where}: end_velocity must be at least 10 and at least start_velocity.",
        )
        _require(0 <= self.switch_parameters <= 63, f"{where}: switch_parameters must be 0..63.")
        _require(self.position_tolerance >= 0, f"{where}: position_tolerance must not be negative.")
        _require(INT32_MIN <= self.home_offset <= INT32_MAX, f"{where}: home_offset must fit 32 bits.")
        if self.soft_limits is not None:
            low, high = self.soft_limits
            _require(
                INT32_MIN <= low < high <= INT32_MAX,
                f"{where}: soft_limits must be (lowest, highest), 32 bits.",
            )

    def _settle_units(self, where: str) -> None:
        known = {STEPS: Fraction(1)}
        if self.gearing is not None:
            _check_gearing(where, self.gearing)
            known |= self.gearing.units
            _require(
                self.unit in known,
                f"{where}: the unit {self.unit} does not follow from the gearing; {', '.join(known)} do "
                "(a length needs a pitch).",
            )
            object.__setattr__(self, "steps_per_unit", known[self.unit])
        else:
            per_unit = self.steps_per_unit
            _require(
                math.isfinite(per_unit) and 1e-9 <= abs(per_unit) < 1e12,
                f"{where}: steps_per_unit must be a finite number from 1e-9 to 1e12, negative or not.",
            )
            object.__setattr__(self, "steps_per_unit", exact(per_unit))
            known = relatives(self.unit, exact(per_unit)) | known
        object.__setattr__(self, "units", known)

    @property
    def target_range(self) -> tuple[int, int]:
        """The targets that the drive takes: `soft_limits` corrected by `home_offset` (manual §6.1.11)."""
        if self.soft_limits is None:
            return INT32_MIN, INT32_MAX
        low, high = self.soft_limits
        return max(INT32_MIN, low - self.home_offset), min(INT32_MAX, high - self.home_offset)


def _check_gearing(where: str, gearing: Gearing) -> None:
    _require(
        1 <= gearing.full_steps <= 65_535, f"{where}: full_steps must be 1..65535 (2001h, manual §4.2.2)."
    )
    _require(
        gearing.microsteps in {1 << exponent for exponent in range(9)},
        f"{where}: microsteps must be a power of 2 from 1 to 256 (2000h, manual §4.2.1).",
    )
    _require(gearing.direction in (1, -1), f"{where}: direction must be 1 or -1.")
    for name, ratio in (("gear", gearing.gear), ("pitch", gearing.pitch_um)):
        if ratio is not None:
            _require(
                ratio > 0 and max(ratio.numerator, ratio.denominator) <= _LARGEST_TERM,
                f"{where}: {name} must be above 0, with at most 15 digits.",
            )


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

    def __post_init__(self) -> None:
        _require(
            1 <= self.node_id <= 127, f"Node {self.name!r}: the node ID must be 1..127, not {self.node_id}."
        )
        _require(bool(self.name.strip()), f"Node {self.node_id} needs a name.")
        _require(not self.name.strip().isdecimal(), f"Node {self.name!r}: a name must not be a bare number.")
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
