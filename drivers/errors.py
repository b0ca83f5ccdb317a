"""One tree of errors for all that the drivers raise. No HTTP in it: `app.http.problems` gives each a status.

Every error says in one sentence what happened, carries where (node, axis, object) and, in `hint`, what to do.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Remedy(enum.StrEnum):
    """A command that takes an obstacle away, where one does; `app` knows how it is given."""

    STOP = "stop"
    """Of the axis."""
    DISABLE = "disable"
    """The axis."""
    ENABLE = "enable"
    """The axis."""
    RESET_FAULT = "reset_fault"
    """Of the axis."""
    HOME = "home"
    """The axis, as it is configured."""
    RESET_STOP = "reset_stop"
    """The latched stop for everything."""
    BOOT = "boot"
    """Take the node in anew."""


class Gravity(enum.IntEnum):
    """How grave an obstacle is: of several, the gravest decides with which error a command is refused."""

    BUSY = 0
    """Only another command is in the way; a stop would end it. `AxisBusy` where that is all."""
    ORDINARY = 1
    """`NotReady`."""
    LATCHED = 2
    """A stop for everything; `StopLatched`."""
    AWAY = 3
    """The node can't be relied on; `NodeAway`."""
    BUS_DOWN = 4
    """Nothing can be sent; `BusDown`."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """One thing that prevents a command now, and its remedy. Made by its row: see `drivers.obstacles`."""

    code: str
    """Stable name in snake_case, e.g. ``not_enabled``."""
    message: str
    """What is the matter, as a sentence."""
    remedy: str
    """What to do about it, as a sentence."""
    action: Remedy | None = None
    """The command that does it; None: it takes waiting, or a person's hands."""
    gravity: Gravity = Gravity.ORDINARY


@dataclass(frozen=True, slots=True)
class BrokenRule:
    """A rule that a setting breaks."""

    field: str
    """The setting's name."""
    rule: str
    """Stable name in snake_case, e.g. ``vstop_at_least_vstart``."""
    message: str
    """The rule, what broke it and where it is written, as a sentence."""


class CanaxisError(Exception):
    """The root. `code` is a stable name in snake_case for programs; `hint` tells a person what to do."""

    code: str = "error"
    hint: str = ""

    def __init__(
        self,
        message: str,
        *,
        hint: str | None = None,
        node: int | None = None,
        axis: int | None = None,
        index: int | None = None,
        sub: int | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        if hint is not None:
            self.hint = hint
        self.node = node
        self.axis = axis
        self.index = index
        self.sub = sub

    def __str__(self) -> str:
        return self.message


# --- the wire ---


class BusError(CanaxisError):
    """The wire, not a node, is the matter."""

    code = "bus_error"
    hint = "Check the CAN interface, its cable and its bit rate; see GET /api/v1/bus."


class BusDown(BusError):
    """The bus can't carry a frame now: not open, unplugged, or bus-off. Whether motors stand is unknown."""

    code = "bus_down"


class BusOverflow(BusError):
    """The transmit queue is full: nobody acknowledges our frames, or we send more than the wire carries."""

    code = "bus_overflow"


# --- a node ---


class NodeError(CanaxisError):
    """Something is the matter with one node."""

    code = "node_error"


class UnknownNode(NodeError):
    """No node of that ID or name is configured."""

    code = "unknown_node"
    hint = "List the configured nodes with GET /api/v1/nodes."


class UnknownAxis(NodeError):
    """The node has no axis of that number or name."""

    code = "unknown_axis"
    hint = "List the node's axes with GET /api/v1/nodes/{node}."


class UnknownTerminal(NodeError):
    """The node has no input or output of that number or name."""

    code = "unknown_terminal"
    hint = "List them with GET /api/v1/nodes/{node}/inputs and outputs."


class InputTimeout(NodeError):
    """An input that was waited for did not get where it should in time."""

    code = "input_timeout"
    hint = "Look at the input (GET inputs), or give it more time."


class NodeAway(NodeError):
    """The node is absent, lost, or not yet configured, so it can't be commanded."""

    code = "node_away"
    hint = "Check the node's supply and cable; it is configured by itself as soon as it answers."


class WrongIdentity(NodeError):
    """The node is something else than the configuration says (1000h, 1018h)."""

    code = "wrong_identity"
    hint = "Correct the node's ID or model in the configuration, or connect the configured module."


class ConfigurationRefused(NodeError):
    """The node refused, or read back differently, something that it must hold before it may be used."""

    code = "configuration_refused"


# --- SDO ---


class Outcome(enum.StrEnum):
    """What a transfer that did not succeed has done to the node."""

    UNKNOWN = "unknown"
    """Maybe what it should, maybe nothing: read back before anything else."""
    REFUSED = "refused"
    """Nothing: the node said no."""
    NOT_SENT = "not_sent"
    """Nothing: the node was not asked."""


class SdoError(NodeError):
    """A service data object transfer did not succeed; `outcome` says what that means for the node."""

    code = "sdo_error"
    outcome = Outcome.UNKNOWN


class SdoAborted(SdoError):
    """The node refused the transfer. `abort_code` and its `meaning` say why (manual section 12)."""

    code = "sdo_aborted"
    outcome = Outcome.REFUSED

    def __init__(
        self, message: str, *, abort_code: int, meaning: str, hint: str | None = None, **where: int | None
    ) -> None:
        super().__init__(message, hint=hint, **where)
        self.abort_code = abort_code
        self.meaning = meaning


class SdoTimeout(SdoError):
    """No answer came in time. A write may or may not have taken effect: read back before anything else."""

    code = "sdo_timeout"
    hint = "The outcome is unknown: read the object back before you write again."


class SdoQueueTimeout(SdoTimeout):
    """Its turn did not come in time; nothing was sent."""

    code = "sdo_queue_timeout"
    hint = "Nothing was sent. Check that the node answers at all; then try again."
    outcome = Outcome.NOT_SENT


class SdoQueueFull(SdoError):
    """The node's queue is full, and nothing less urgent waits in it; nothing was sent."""

    code = "sdo_queue_full"
    hint = "Nothing was sent. Ask this node less often, or wait a moment and try again."
    outcome = Outcome.NOT_SENT


class SdoProtocolError(SdoError):
    """The node's answer broke the protocol (wrong toggle, wrong length); we aborted the transfer."""

    code = "sdo_protocol"
    hint = "Check for a second node with the same ID, or for a second master on the bus."


class UnknownObject(NodeError):
    """The module's profile holds no such object."""

    code = "unknown_object"
    hint = "See the object dictionary of the module's manual; sub-indices are decimal, indices hexadecimal."


class BadValue(CanaxisError):
    """A value is outside what the object or the command takes. Nothing was sent."""

    code = "bad_value"


class RulesBroken(BadValue):
    """Settings break rules of the module's manual or our own; `rules` names each. Nothing was sent."""

    hint = "Correct the settings that are named; nothing was changed."

    def __init__(
        self, what: str, rules: tuple[BrokenRule, ...], *, node: int | None = None, axis: int | None = None
    ) -> None:
        super().__init__(f"{what}: {' '.join(rule.message for rule in rules)}", node=node, axis=axis)
        self.rules = rules


class TrajectoryRefused(BadValue):
    """The axes can't follow that path; nothing was sent. Says where it fails first."""

    code = "trajectory_refused"

    def __init__(
        self,
        message: str,
        *,
        hint: str,
        point: int,
        time_s: float,
        quantity: str,
        value: float,
        limit: float,
        node: int | None = None,
        axis: int | None = None,
    ) -> None:
        """`value` and `limit` are in steps and seconds, as `quantity` has it; `point` counts from 0."""
        super().__init__(message, hint=hint, node=node, axis=axis)
        self.point = point
        self.time_s = time_s
        self.quantity = quantity
        self.value = value
        self.limit = limit


class GuardedObject(NodeError):
    """Writing this object could endanger motion: it needs a confirmation, or is never allowed."""

    code = "guarded_object"


# --- an axis ---


class AxisError(NodeError):
    """Something is the matter with one axis."""

    code = "axis_error"


class NotReady(AxisError):
    """The axis can't do this now; `obstacles` names each reason with its remedy. Nothing was sent."""

    code = "not_ready"

    def __init__(
        self, message: str, *, obstacles: tuple[Obstacle, ...], hint: str | None = None, **where: int | None
    ) -> None:
        super().__init__(
            message, hint=hint if hint is not None else " ".join(o.remedy for o in obstacles), **where
        )
        self.obstacles = obstacles


class AxisBusy(NotReady):
    """Another command holds the axis; a stop would end it."""

    code = "axis_busy"


class LineFull(NotReady):
    """As much waits for the axis as may; nothing was sent."""

    code = "axis_queue_full"

    def __init__(
        self,
        message: str,
        *,
        obstacles: tuple[Obstacle, ...],
        frees_in_s: float = 1.0,
        node: int | None = None,
        axis: int | None = None,
    ) -> None:
        super().__init__(message, obstacles=obstacles, node=node, axis=axis)
        self.frees_in_s = frees_in_s
        """When a place becomes free, as far as it can be told."""


class StopLatched(NotReady):
    """A stop for everything was given and not yet reset."""

    code = "stop_latched"


class MotionFailed(AxisError):
    """A motion that had begun did not reach its end."""

    code = "motion_failed"


class MotionTimeout(MotionFailed):
    """A motion did not end in the time that it should have taken; the axis was told to stop."""

    code = "motion_timeout"


class AxisFault(MotionFailed):
    """The drive went to FAULT; the active emergencies say why."""

    code = "axis_fault"
    hint = "Remove the cause, then POST reset-fault and enable the axis again."


class TransitionTimeout(AxisError):
    """The drive did not reach a CiA 402 state in time."""

    code = "transition_timeout"
    hint = "Read the axis's status; look at the supply and the enable input of the module, then try again."
