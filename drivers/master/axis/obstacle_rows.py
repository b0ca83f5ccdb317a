"""THE table of what prevents the commands of an axis: one row each, in the order of taking away.

Whoever adds an obstacle adds a row, and its condition below; the service shows it as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from drivers import obstacles as kinds
from drivers.cia402.power import PowerState
from drivers.errors import Gravity, Obstacle, Remedy
from drivers.master.axis.body import AxisBody
from drivers.master.axis.commands import MOTION_COMMANDS, AxisCommand, Question
from drivers.master.axis.errands import COMING_TO_REST, MOTIONS, ErrandName
from drivers.master.motions.homing import needs_enabled
from drivers.master.motions.motion import Motion
from drivers.master.plan.requests import VelocityRequest
from drivers.master.seen.status import Failsafe, NodeState
from drivers.obstacles import ObstacleKind

EVERY: Final = frozenset(AxisCommand) - {AxisCommand.STOP, AxisCommand.QUICK_STOP}
"""A stop is never prevented."""
ENERGISING: Final = MOTION_COMMANDS | {AxisCommand.ENABLE}


@dataclass(frozen=True, slots=True)
class Row:
    """One obstacle: what it is called, which commands it can prevent, and when."""

    kind: ObstacleKind
    concerns: frozenset[AxisCommand]
    matter: Callable[[AxisBody, Question], str | None]
    """What is the matter now, as a sentence; None: nothing."""

    def look(self, axis: AxisBody, question: Question) -> Obstacle | None:
        """The obstacle, if it is in the way of the command."""
        if question.command not in self.concerns:
            return None
        message = self.matter(axis, question)
        return None if message is None else self.kind.found(message, node=axis.node.node_id)


# --- the conditions ---


def _closing(axis: AxisBody, _: Question) -> str | None:
    return kinds.CLOSES if axis.backbone.closing else None


def _bus_down(axis: AxisBody, _: Question) -> str | None:
    bus = axis.backbone.bus
    if bus.state.can_send:
        return None
    return f"The bus {bus.name} is {bus.state}: nothing can be commanded; whether motors stand is unknown."


def _node_in(*states: NodeState) -> Callable[[AxisBody, Question], str | None]:
    def matter(axis: AxisBody, _: Question) -> str | None:
        node = axis.node
        if node.state not in states:
            return None
        return f"Node {node.name} is {node.state}{': ' + node.reason if node.reason else '.'}"

    return matter


def _operational(axis: AxisBody) -> bool:
    return axis.node.state is NodeState.OPERATIONAL


def _heartbeat_stale(axis: AxisBody, _: Question) -> str | None:
    late = _operational(axis) and axis.node.heartbeat_stale
    return f"The heartbeat of node {axis.node.name} is late." if late else None


def _status_stale(axis: AxisBody, _: Question) -> str | None:
    stale = _operational(axis) and not axis.node.heartbeat_stale and axis.status.stale
    return "The axis's status is too old to be trusted." if stale else None


def _stop_latched(axis: AxisBody, _: Question) -> str | None:
    latch = axis.backbone.stop_latched
    return None if latch is None else f"A stop for everything is latched: {latch.reason}"


def _heartbeat_paused(axis: AxisBody, _: Question) -> str | None:
    if not axis.backbone.heartbeat_paused:
        return None
    return "Our heartbeat pauses for a check of the fail-safe; the modules are about to stop their motors."


def _failsafe_off(axis: AxisBody, _: Question) -> str | None:
    off = axis.node.failsafe is Failsafe.OFF and not axis.backbone.config.allow_unverified_failsafe
    if not (_operational(axis) and off):  # before it is operational it was not yet asked to take 1029h
        return None
    return "The module would not take 1029h:1, so nothing stops its motors should this service die."


def _unsettled(axis: AxisBody, _: Question) -> str | None:
    return axis.unsettled or None


def _fault(axis: AxisBody, _: Question) -> str | None:
    status = axis.status
    if status.state not in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
        return None
    causes = "; ".join(e.title for e in status.emergencies)
    return f"The drive is in {status.state}{': ' + causes if causes else ''}."


def _held_by(*, ends: bool) -> Callable[[AxisBody, Question], str | None]:
    """An errand that a stop ends, or one that must be waited for."""

    def matter(axis: AxisBody, question: Question) -> str | None:
        errand = axis.errand
        if errand is None or (errand in (*MOTIONS, ErrandName.FOLLOWING)) is not ends:
            return None
        if _takes_over(axis, question) or _joins(errand, question.command):
            return None
        return f"The axis is {errand}."

    return matter


def _takes_over(axis: AxisBody, question: Question) -> bool:
    return (
        question.command is AxisCommand.VELOCITY
        and not question.from_rest
        and axis.errand is ErrandName.TURNING
        and isinstance(axis.motion, Motion)
        and isinstance(axis.motion.request, VelocityRequest)
        and axis.motion.request.plain
        and not axis.queued
    )


def _joins(errand: ErrandName, command: AxisCommand) -> bool:
    """A fault reset energises nothing, so it may wait for a stop; an enable behind a stop would undo it."""
    return (command is AxisCommand.ENABLE and errand is ErrandName.ENABLING) or (
        command is AxisCommand.RESET_FAULT and (errand is ErrandName.RESETTING or errand in COMING_TO_REST)
    )


def _configuring(axis: AxisBody, _: Question) -> str | None:
    return "The axis's settings are being changed." if axis.configuring else None


def _turns_unasked(axis: AxisBody) -> bool:
    return axis.errand is None and axis.status.moving


def _moving(axis: AxisBody, _: Question) -> str | None:
    unclaimed = _turns_unasked(axis) and axis.adopted
    return "The axis turns since before this service started." if unclaimed else None


def _turning(axis: AxisBody, question: Question) -> str | None:
    must_stand = question.from_rest or (question.command.is_motion and axis.adopted)
    return "The axis is turning." if _turns_unasked(axis) and must_stand else None


def _adopted(axis: AxisBody, _: Question) -> str | None:
    return None if axis.status.adopted is None else axis.status.adopted.reason


def _not_enabled(axis: AxisBody, question: Question) -> str | None:
    status = axis.status
    if status.adopted is not None or status.state is PowerState.OPERATION_ENABLED:
        return None
    method = axis.config.homing_method if question.method is None else question.method
    if question.command is AxisCommand.HOME and not needs_enabled(method):
        return None
    return f"The axis is {status.state or 'in no known state'}."


def _not_referenced(axis: AxisBody, question: Question) -> str | None:
    needed = question.absolute and axis.config.require_homing and not axis.status.referenced
    return "The axis was not homed since the module's last reset." if needed else None


# --- the table ---

ROWS: Final = (
    Row(kinds.CLOSING, EVERY, _closing),
    Row(
        ObstacleKind(
            "bus_down", "Check the CAN interface; it is opened again by itself.", gravity=Gravity.BUS_DOWN
        ),
        EVERY,
        _bus_down,
    ),
    Row(
        ObstacleKind(
            "node_away",
            "Check the node's supply and cable; it is taken in by itself as soon as it answers.",
            gravity=Gravity.AWAY,
        ),
        EVERY,
        _node_in(NodeState.ABSENT, NodeState.LOST),
    ),
    Row(
        ObstacleKind("node_away", "Wait a moment: it becomes operational by itself.", gravity=Gravity.AWAY),
        EVERY,
        _node_in(NodeState.BOOTED, NodeState.IDENTIFIED, NodeState.CONFIGURED),
    ),
    Row(
        ObstacleKind(
            "node_away", "Correct the configuration, or connect the configured module.", gravity=Gravity.AWAY
        ),
        EVERY,
        _node_in(NodeState.REFUSED),
    ),
    Row(
        ObstacleKind(
            "node_away",
            "Give every node on the bus an ID of its own, then reset the node.",
            gravity=Gravity.AWAY,
        ),
        EVERY,
        _node_in(NodeState.DUPLICATE),
    ),
    Row(
        ObstacleKind("heartbeat_stale", "Wait until it is back, or check the cable.", gravity=Gravity.AWAY),
        EVERY,
        _heartbeat_stale,
    ),
    Row(
        ObstacleKind("status_stale", "Wait a moment; then check the node's PDOs."),
        EVERY,
        _status_stale,
    ),
    Row(
        ObstacleKind(
            "stop_latched",
            "Reset it on purpose with POST /api/v1/stop/reset.",
            Remedy.RESET_STOP,
            Gravity.LATCHED,
        ),
        ENERGISING,
        _stop_latched,
    ),
    Row(
        ObstacleKind("heartbeat_paused", "Wait until the check has ended."),
        ENERGISING,
        _heartbeat_paused,
    ),
    Row(
        ObstacleKind(
            "failsafe_off",
            "Check the module's firmware, or allow it in the configuration with allow_unverified_failsafe.",
        ),
        ENERGISING,
        _failsafe_off,
    ),
    Row(
        ObstacleKind(
            "settings_unsettled",
            "Take the node in anew: POST /api/v1/nodes/{node}/boot, with its axes disabled.",
            Remedy.BOOT,
        ),
        ENERGISING,
        _unsettled,
    ),
    Row(
        ObstacleKind("fault", "Remove the cause, then reset the fault.", Remedy.RESET_FAULT),
        ENERGISING,
        _fault,
    ),
    Row(
        ObstacleKind("busy", "Wait until it has ended, or stop the axis.", Remedy.STOP, Gravity.BUSY),
        EVERY - {AxisCommand.DISABLE},
        _held_by(ends=True),
    ),
    Row(
        ObstacleKind("busy", "Wait until it has ended.", gravity=Gravity.BUSY),
        EVERY - {AxisCommand.DISABLE},
        _held_by(ends=False),
    ),
    Row(
        ObstacleKind("busy", "Wait a moment, then try again.", gravity=Gravity.BUSY),
        EVERY - {AxisCommand.DISABLE},
        _configuring,
    ),
    Row(
        ObstacleKind("moving", "Stop it first.", Remedy.STOP),
        frozenset({AxisCommand.ENABLE}),
        _moving,
    ),
    Row(
        ObstacleKind("turning", "Stop the axis first.", Remedy.STOP, Gravity.BUSY),
        MOTION_COMMANDS | {AxisCommand.SETTINGS},
        _turning,
    ),
    Row(
        ObstacleKind("adopted", "Stop the axis, then enable it: that claims it.", Remedy.ENABLE),
        MOTION_COMMANDS | {AxisCommand.SETTINGS},
        _adopted,
    ),
    Row(
        ObstacleKind("not_enabled", "Enable the axis.", Remedy.ENABLE),
        MOTION_COMMANDS - {AxisCommand.SET_POSITION},
        _not_enabled,
    ),
    Row(
        ObstacleKind("not_referenced", "Home the axis.", Remedy.HOME),
        frozenset({AxisCommand.MOVE}),
        _not_referenced,
    ),
)
