"""What goes wrong, as classes: one tree, by HTTP status and then by the problem's `code`.

Catch as wide as you mean: `NotReady` is a `Conflict`, which is a `CanaxisError`. A code that this client
doesn't know yet becomes the class of its status.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from canaxis.obstacles import Obstacle, obstacles_of, rows


class CanaxisError(Exception):
    """Something went wrong; `str()` says what, and what to do about it.

    `detail` and `hint` are those two sentences. `code` is the stable name for programs, `status` the HTTP
    status (None where no answer came), `obstacles` what prevents the command, `problem` all that the service
    said (RFC 9457), also what this client has no name for.
    """

    status_class: ClassVar[int | None] = None
    """The HTTP status whose unknown codes become this class."""
    codes: ClassVar[tuple[str, ...]] = ()
    """The problems that become this class."""

    def __init__(
        self,
        detail: str,
        *,
        hint: str = "",
        code: str = "",
        status: int | None = None,
        problem: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(f"{detail} {hint}".strip())
        self.detail = detail
        self.hint = hint
        self.code = code
        self.status = status
        self.problem: Mapping[str, Any] = problem or {}

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What prevents the command, in the service's order; empty where it named nothing."""
        return obstacles_of(self.problem)


# --- without the service's word ---


class ServiceUnreachable(CanaxisError):
    """No connection came about, however often it was tried: nothing was carried out."""


class OutcomeUnknown(ServiceUnreachable):
    """The connection broke and no answer could be had: the command may have been carried out, or still be."""


class BadReply(CanaxisError):
    """The answer is none that a Canaxis service gives: a proxy's page, or another program's."""


class WaitTimeout(CanaxisError, TimeoutError):
    """An operation didn't end as soon as the caller wanted; it goes on."""


class OperationCancelled(CanaxisError):
    """An operation was ended before its goal: by a stop, a cancel, or another command. `detail` says why."""


# --- by status, then by code ---


class Unauthorized(CanaxisError):
    """401: the token is missing or wrong."""

    status_class, codes = 401, ("unauthorized",)


class Forbidden(CanaxisError):
    """403: the service's settings don't allow it."""

    status_class = 403


class NotFound(CanaxisError):
    """404: there is no such thing."""

    status_class = 404


class UnknownNode(NotFound):
    """No node of that ID or name is configured."""

    codes = ("unknown_node",)


class UnknownAxis(NotFound):
    """The node has no such axis."""

    codes = ("unknown_axis",)


class UnknownOperation(NotFound):
    """No such operation, or it was forgotten some time after it ended."""

    codes = ("unknown_operation",)


class UnknownTerminal(NotFound):
    """The node has no such input or output."""

    codes = ("unknown_terminal",)


class UnknownPosition(NotFound):
    """The axis has no position of that name."""

    codes = ("unknown_position",)


class UnknownObject(NotFound):
    """The module has no such object."""

    codes = ("unknown_object",)


class Conflict(CanaxisError):
    """409: not in this state. Nothing was sent."""

    status_class = 409


class NotReady(Conflict):
    """The axis can't do that now: `obstacles` says why."""

    codes = ("not_ready",)


class Busy(Conflict):
    """An operation holds the axis."""

    codes = ("axis_busy",)


class StopLatched(Conflict):
    """Everything was stopped, and nobody has reset that yet."""

    codes = ("stop_latched",)


class AxisFault(Conflict):
    """The drive is in fault."""

    codes = ("axis_fault",)


class GuardedObject(Conflict):
    """Writing the object could endanger motion."""

    codes = ("guarded_object",)


class KeyInFlight(Conflict):
    """A command with this key is still being carried out, and was for as long as the client asked again."""

    codes = ("key_in_flight",)


class PreconditionFailed(CanaxisError):
    """412: what was to be changed is not as it was seen any more. Nothing was changed."""

    status_class, codes = 412, ("precondition_failed",)


class PreconditionRequired(CanaxisError):
    """428: a change must say from what it was made."""

    status_class, codes = 428, ("precondition_required",)


class BadValue(CanaxisError):
    """422: a value that can't be. Nothing was sent."""

    status_class = 422


class KeyReused(BadValue):
    """The key was used before, for another command."""

    codes = ("key_reused",)


class Locked(CanaxisError):
    """423: somebody has exclusive control, and it isn't this client."""

    status_class = 423


class Leased(Locked):
    """The axis is leased to someone else: `owner` has it for `expires_in_s` more seconds, if not renewed."""

    codes = ("leased",)

    @property
    def owner(self) -> str:
        """Who has it, in its own words."""
        return str(self.problem.get("owner") or "")

    @property
    def expires_in_s(self) -> float | None:
        """Seconds until it expires unless it is renewed."""
        left = self.problem.get("expires_in_s")
        return float(left) if isinstance(left, int | float) else None


class LeaseLost(Locked):
    """The lease under which it was sent expired, was released or taken over. Nothing was sent."""

    codes = ("lease_lost",)


class TooManyRequests(CanaxisError):
    """429: faster than the service's settings allow, for as long as the client asked again."""

    status_class = 429


class ServiceFault(CanaxisError):
    """500: a fault of the service; its log says more."""

    status_class = 500


class NodeFailed(CanaxisError):
    """502: the node didn't do what it was told."""

    status_class = 502


class MotionFailed(NodeFailed):
    """A motion was begun and did not come to its goal."""

    codes = ("motion_failed",)


class SdoAborted(NodeFailed):
    """The node refused the transfer of an object."""

    codes = ("sdo_aborted",)


class Unavailable(CanaxisError):
    """503: not now, for a reason outside the command."""

    status_class = 503


class QueueFull(Unavailable):
    """As much waits for the axis as may. Nothing was sent."""

    codes = ("axis_queue_full",)


class NodeAway(Unavailable):
    """The node is not there, or not ready yet."""

    codes = ("node_away", "wrong_identity", "duplicate_node")


class BusDown(Unavailable):
    """No frames flow on the bus."""

    codes = ("bus_error", "bus_down", "bus_overflow")


class ServiceRestarted(Unavailable):
    """The service ended while the operation ran; `evidence.found` says how the axes were found afterwards."""

    codes = ("service_restarted",)


class NoAnswer(CanaxisError):
    """504: the node didn't answer, or didn't get there, in time."""

    status_class = 504


class InputTimeout(NoAnswer):
    """An input that was waited for did not get there in time."""

    codes = ("input_timeout",)


class MotionTimeout(NoAnswer):
    """A motion took longer than it can; the axis was told to stop."""

    codes = ("motion_timeout",)


def _tree(top: type[CanaxisError]) -> list[type[CanaxisError]]:
    return [top, *(each for below in top.__subclasses__() for each in _tree(below))]


_KINDS = [(kind, vars(kind)) for kind in _tree(CanaxisError)]
_BY_CODE = {code: kind for kind, own in _KINDS for code in own.get("codes", ())}
_BY_STATUS = {own["status_class"]: kind for kind, own in _KINDS if "status_class" in own}


def of_problem(problem: Mapping[str, Any], status: int | None = None) -> CanaxisError:
    """The error for a problem object; `status` counts where the object names none."""
    code = str(problem.get("code", ""))
    named = problem.get("status", status)
    kind = _BY_CODE.get(code) or _BY_STATUS.get(named) or CanaxisError
    detail = str(problem.get("detail") or problem.get("title") or f"The service answered {named}.")
    return kind(
        _with_fields(detail, problem),
        hint=str(problem.get("hint") or ""),
        code=code,
        status=named if isinstance(named, int) else status,
        problem=problem,
    )


def _with_fields(detail: str, problem: Mapping[str, Any]) -> str:
    fields = [f"{row.get('field')}: {row.get('message')}" for row in rows(problem.get("errors"))]
    return f"{detail} ({'; '.join(fields)})" if fields else detail
