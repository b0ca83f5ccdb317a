"""What prevents a command now: every obstacle with its remedy, and the error that fits the gravest."""

from __future__ import annotations

import enum
from collections.abc import Iterator

from drivers.cia402.power import PowerState
from drivers.errors import (
    AxisBusy,
    BusDown,
    CanaxisError,
    NodeAway,
    NotReady,
    Obstacle,
    Remedy,
    StopLatched,
)
from drivers.master.axis.body import AxisBody
from drivers.master.axis.errands import COMING_TO_REST, MOTIONS, ErrandName
from drivers.master.motions.homing import needs_enabled
from drivers.master.motions.motion import Motion
from drivers.master.plan.requests import VelocityRequest
from drivers.master.seen.status import Adoption, Failsafe, NodeState


class AxisCommand(enum.StrEnum):
    """What can be asked of an axis."""

    ENABLE = "enable"
    DISABLE = "disable"
    RESET_FAULT = "reset_fault"
    MOVE = "move"
    VELOCITY = "velocity"
    HOME = "home"
    SET_POSITION = "set_position"
    JOG = "jog"
    STOP = "stop"
    QUICK_STOP = "quick_stop"
    SETTINGS = "change_settings"

    @property
    def is_motion(self) -> bool:
        """Whether it is an operation: a latched stop prevents it, and so does an adopted axis."""
        return self in _MOTIONS


_MOTIONS = frozenset(
    {
        AxisCommand.MOVE,
        AxisCommand.VELOCITY,
        AxisCommand.HOME,
        AxisCommand.SET_POSITION,
        AxisCommand.JOG,
    }
)
_AWAY = frozenset({"bus_down", "node_away", "heartbeat_stale"})

CLOSING = Obstacle("closing", "The service is shutting down.", "Start the service again.")
_UNREACHED = "Check the node's supply and cable; it is taken in by itself as soon as it answers."
_BEING_TAKEN_IN = "Wait a moment: it becomes operational by itself."
_REMEDIES = {
    NodeState.ABSENT: _UNREACHED,
    NodeState.LOST: _UNREACHED,
    NodeState.BOOTED: _BEING_TAKEN_IN,
    NodeState.IDENTIFIED: _BEING_TAKEN_IN,
    NodeState.CONFIGURED: _BEING_TAKEN_IN,
    NodeState.REFUSED: "Correct the configuration, or connect the configured module.",
    NodeState.DUPLICATE: "Give every node on the bus an ID of its own, then reset the node.",
}
"""What to do about a node that is not operational."""


def obstacles(
    axis: AxisBody,
    command: AxisCommand,
    *,
    absolute: bool = True,
    method: int | None = None,
    from_rest: bool | None = None,
) -> tuple[Obstacle, ...]:
    """Everything that prevents `command` now, in the order in which it is best taken away; empty: it may be
    given.

    `absolute` matters for a move, `method` (None: the configured one) for a homing; `from_rest` is whether
    the axis must stand first (None: as such commands do). A stop is never prevented.
    """
    if command in (AxisCommand.STOP, AxisCommand.QUICK_STOP):
        return ()
    if from_rest is None:
        from_rest = command is not AxisCommand.VELOCITY and (
            command.is_motion or command is AxisCommand.SETTINGS
        )
    found = [*_reach(axis)]
    energises = command is AxisCommand.ENABLE or command.is_motion
    if energises:
        found += [*_permission(axis), *_settled(axis), *_fault(axis)]
    found += _busy(axis, command, from_rest)
    if command is AxisCommand.SETTINGS and axis.status.adopted is not None:
        found.append(_adopted(axis.status.adopted))
    if command.is_motion:
        found += _power(axis, command, method)
    if command is AxisCommand.MOVE and absolute and axis.config.require_homing and not axis.status.referenced:
        found.append(
            Obstacle(
                "not_referenced",
                "The axis was not homed since the module's last reset.",
                "Home the axis.",
                Remedy.HOME,
            )
        )
    return tuple(found)


def refusal(axis: AxisBody, command: AxisCommand, found: tuple[Obstacle, ...]) -> CanaxisError:
    """The error for these obstacles (at least one): the wire before the node before the latch before the
    rest.
    """
    node, number = axis.node.node_id, axis.number
    codes = {obstacle.code for obstacle in found}
    reasons = " ".join(obstacle.message for obstacle in found)
    remedies = " ".join(obstacle.remedy for obstacle in found)
    message = f"Axis {axis.name} can't do {command} now: {reasons}"
    if "bus_down" in codes:
        return BusDown(message, hint=remedies, node=node, axis=number)
    if codes & _AWAY:
        return NodeAway(message, hint=remedies, node=node, axis=number)
    if "stop_latched" in codes:
        return StopLatched(message, obstacles=found, node=node, axis=number)
    if codes <= {"busy", "turning", "endless"}:
        return AxisBusy(message, obstacles=found, node=node, axis=number)
    return NotReady(message, obstacles=found, node=node, axis=number)


def _reach(axis: AxisBody) -> Iterator[Obstacle]:
    node = axis.node
    bus = axis.backbone.bus
    if axis.backbone.closing:
        yield CLOSING
    if not bus.state.can_send:
        yield Obstacle(
            "bus_down",
            f"The bus {bus.name} is {bus.state}: nothing can be commanded; whether motors stand is unknown.",
            "Check the CAN interface; it is opened again by itself.",
        )
    if node.state is not NodeState.OPERATIONAL:
        yield Obstacle(
            "node_away",
            f"Node {node.name} is {node.state}{': ' + node.reason if node.reason else '.'}",
            _REMEDIES[node.state],
        )
    elif node.heartbeat_stale:
        yield Obstacle(
            "heartbeat_stale",
            f"The heartbeat of node {node.name} is late.",
            "Wait until it is back, or check the cable.",
        )
    elif axis.status.stale:
        yield Obstacle(
            "status_stale",
            "The axis's status is too old to be trusted.",
            "Wait a moment; then check the node's PDOs.",
        )


def _permission(axis: AxisBody) -> Iterator[Obstacle]:
    latch = axis.backbone.stop_latched
    if latch is not None:
        yield Obstacle(
            "stop_latched",
            f"A stop for everything is latched: {latch.reason}",
            "Reset it on purpose with POST /api/v1/stop/reset.",
            Remedy.RESET_STOP,
        )
    if axis.backbone.heartbeat_paused:
        yield Obstacle(
            "heartbeat_paused",
            "Our heartbeat pauses for a check of the fail-safe; the modules are about to stop their motors.",
            "Wait until the check has ended.",
        )
    known = axis.node.state is NodeState.OPERATIONAL  # before that it was not yet asked to take 1029h
    if known and axis.node.failsafe is Failsafe.OFF and not axis.backbone.config.allow_unverified_failsafe:
        yield Obstacle(
            "failsafe_off",
            "The module would not take 1029h:1, so nothing stops its motors should this service die.",
            "Check the module's firmware, or allow it in the configuration with allow_unverified_failsafe.",
        )


def _settled(axis: AxisBody) -> Iterator[Obstacle]:
    if axis.unsettled:
        yield Obstacle(
            "settings_unsettled",
            axis.unsettled,
            f"Take the node in anew: POST /api/v1/nodes/{axis.node.node_id}/boot, with its axes disabled.",
            Remedy.BOOT,
        )


def _fault(axis: AxisBody) -> Iterator[Obstacle]:
    status = axis.status
    if status.state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
        causes = "; ".join(e.title for e in status.emergencies)
        yield Obstacle(
            "fault",
            f"The drive is in {status.state}{': ' + causes if causes else ''}.",
            "Remove the cause, then reset the fault.",
            Remedy.RESET_FAULT,
        )


def _busy(axis: AxisBody, command: AxisCommand, from_rest: bool) -> Iterator[Obstacle]:
    errand = axis.errand
    takes_over = (
        command is AxisCommand.VELOCITY
        and not from_rest
        and errand is ErrandName.TURNING
        and isinstance(axis.motion, Motion)
        and isinstance(axis.motion.request, VelocityRequest)
        and axis.motion.request.plain
        and not axis.queued
    )
    # A fault reset energises nothing, so it may wait for a stop; an enable behind a stop would undo it.
    joins = (command is AxisCommand.ENABLE and errand is ErrandName.ENABLING) or (
        command is AxisCommand.RESET_FAULT and (errand is ErrandName.RESETTING or errand in COMING_TO_REST)
    )
    if errand is not None and command is not AxisCommand.DISABLE and not takes_over and not joins:
        ends = errand in (*MOTIONS, ErrandName.FOLLOWING)
        yield Obstacle(
            "busy",
            f"The axis is {errand}.",
            "Wait until it has ended, or stop the axis." if ends else "Wait until it has ended.",
            Remedy.STOP if ends else None,
        )
    if axis.configuring and command is not AxisCommand.DISABLE:
        yield Obstacle("busy", "The axis's settings are being changed.", "Wait a moment, then try again.")
    if errand is not None or not axis.status.moving:
        return
    if command is AxisCommand.ENABLE and axis.adopted:
        yield Obstacle(
            "moving", "The axis turns since before this service started.", "Stop it first.", Remedy.STOP
        )
    elif from_rest or (command.is_motion and axis.adopted):
        yield Obstacle("turning", "The axis is turning.", "Stop the axis first.", Remedy.STOP)


def _power(axis: AxisBody, command: AxisCommand, method: int | None) -> Iterator[Obstacle]:
    status = axis.status
    if status.adopted is not None:
        yield _adopted(status.adopted)
    elif status.state is not PowerState.OPERATION_ENABLED:
        chosen = axis.config.homing_method if method is None else method
        powerless = command is AxisCommand.SET_POSITION or (
            command is AxisCommand.HOME and not needs_enabled(chosen)
        )
        if not powerless:
            yield Obstacle(
                "not_enabled",
                f"The axis is {status.state or 'in no known state'}.",
                "Enable the axis.",
                Remedy.ENABLE,
            )


def _adopted(adoption: Adoption) -> Obstacle:
    return Obstacle(
        "adopted", adoption.reason, "Stop the axis, then enable it: that claims it.", Remedy.ENABLE
    )
