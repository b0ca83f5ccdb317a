"""What a person configures: the bus's nodes, their axes, and how each axis should move.

What an axis's settings mean is in `axis_fields`. Everything is checked when it is made, before a frame is
sent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

from drivers.errors import BadValue, BrokenRule, RulesBroken
from drivers.master.plan.axis_fields import HIGHEST_RATE, INT32_MAX, INT32_MIN, AxisFields
from drivers.master.plan.axis_rules import broken_gearing, broken_rules
from drivers.master.plan.gearing import STEPS, exact, relatives

__all__ = ["HIGHEST_RATE", "INT32_MAX", "INT32_MIN", "AxisConfig", "NetworkConfig", "NodeConfig"]


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise BadValue(message, hint="Correct the configuration of the axis or node named in the message.")


class Limits(NamedTuple):
    """Lowest and highest target, steps."""

    lower: int
    upper: int


@dataclass(frozen=True, slots=True)
class AxisConfig(AxisFields):
    """How one axis moves when a command leaves something out, and what the module must hold before it may."""

    units: Mapping[str, Fraction] = field(init=False, repr=False, compare=False)
    """Steps in one of each unit that the axis can be commanded in: `unit`, and what follows from it."""

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
