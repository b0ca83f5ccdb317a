"""THE table: what went wrong -> HTTP status and problem type (RFC 9457).

Each type has a `code`; its URI is the relative reference ``/problems/{code with dashes}``, which this service
answers with the type's description. Nothing else in the service chooses a status for an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, NamedTuple, cast

from app.http import remedies
from drivers import errors

MEDIA_TYPE = "application/problem+json"


class ProblemType(NamedTuple):
    """One row of the table."""

    code: str
    status: int
    title: str
    explanation: str
    """What to do, for the page behind the type's URI; the hint where the error brings none."""
    wait: float | None = None
    """Seconds after which it is worth to try again (`Retry-After`), where waiting helps and nothing better is
    known."""

    @property
    def uri(self) -> str:
        """The `type` member: a reference relative to this service."""
        return "/problems/" + self.code.replace("_", "-")


_ROWS = (
    # What the service itself says.
    ("unknown_path", 404, "No such resource", "Look the paths up at /docs."),
    ("unknown_operation", 404, "No such operation", "Operations are forgotten some time after they ended."),
    ("unknown_revision", 404, "No such revision", "List them with GET /api/v1/settings/revisions."),
    ("unknown_problem", 404, "No such problem type", "The types are listed in the API's documentation."),
    ("method_not_allowed", 405, "Method not allowed", "The Allow header says what this path takes."),
    ("unauthorized", 401, "Token missing or wrong", "Send the header Authorization: Bearer with the token."),
    (
        "token_in_url",
        400,
        "Token in the URL",
        "Send Authorization: Bearer instead; for streams a ticket.",
    ),
    ("forbidden_role", 403, "Role not sufficient", "Use a token of that role; `canaxis token` makes one."),
    ("request_timeout", 408, "Request too slow", "Send the request in one piece, then try again."),
    (
        "too_many_requests",
        429,
        "Too many requests",
        "Wait as Retry-After says; see server.requests_per_second.",
    ),
    ("forbidden_origin", 403, "Page of a foreign origin", "Add the page's origin to server.allowed_origins."),
    ("objects_read_only", 403, "Object writes are off", "Set objects.writable to true to allow raw writes."),
    ("body_too_large", 413, "Body too large", "No request needs more than 64 KiB, besides trajectories."),
    ("json_required", 415, "JSON content type required", "Send Content-Type: application/json, body or not."),
    (
        "media_type_unknown",
        415,
        "Content type not taken",
        "Send application/json or text/csv, as the path's documentation says.",
    ),
    ("no_room", 503, "No room for the body", "Free some space, or set trajectories.folder to another disk."),
    ("misdirected", 421, "Unknown Host", "Use the service's own address, or add it to server.allowed_hosts."),
    (
        "precondition_required",
        428,
        "If-Match required",
        "GET the settings, then send their ETag in If-Match, so that nobody's change is lost.",
    ),
    (
        "precondition_failed",
        412,
        "Settings changed meanwhile",
        "GET the settings anew, look at what changed, then send your change with the new ETag.",
    ),
    (
        "bad_request",
        422,
        "Request not understood",
        "Correct what `detail` and `errors` name, then send it again.",
    ),
    ("key_reused", 422, "Idempotency key used before", "Send a new Idempotency-Key with each new command."),
    (
        "key_in_flight",
        409,
        "Same command in flight",
        "Wait for the first request's answer, or ask again later.",
    ),
    ("unknown_lease", 404, "No such lease", "List the leases with GET /api/v1/leases."),
    (
        "leased",
        423,
        "Leased to someone else",
        "Wait as Retry-After says, ask its owner, or take a lease with force. A stop needs no lease.",
    ),
    (
        "lease_lost",
        423,
        "Lease not held",
        "Its axes were stopped, unless it was released. Look at them, then take a new lease.",
    ),
    ("too_many_streams", 503, "Too many event streams", "Close a stream, or raise server.max_streams."),
    ("shutting_down", 503, "Service is shutting down", "Wait until the service runs again."),
    (
        "history_off",
        503,
        "History is off",
        "The store can't be read; see /readyz. Motion is not affected.",
    ),
    (
        "store_off",
        503,
        "Store is off",
        "Try again once /readyz says that the store works; what was known before is still used.",
    ),
    (
        "service_restarted",
        503,
        "Service ended meanwhile",
        "See `evidence.found`, read the axis's status, then command it again if it is still wanted.",
    ),
    ("internal_error", 500, "Unexpected error", "This is a fault of the service; its log says more."),
    # What the drivers say.
    ("error", 500, "Unexpected driver error", "This is a fault of the service; its log says more."),
    ("unknown_node", 404, "No such node", "List the configured nodes with GET /api/v1/nodes."),
    ("unknown_axis", 404, "No such axis", "List the node's axes with GET /api/v1/nodes/{node}/axes."),
    (
        "unknown_object",
        404,
        "No such object",
        "The module's manual lists its objects; indices are hexadecimal.",
    ),
    ("unknown_position", 404, "No such position", "List them with GET positions of the axis."),
    ("unknown_terminal", 404, "No such input or output", "List them with GET inputs and GET outputs."),
    ("input_timeout", 504, "Input did not get there in time", "Look at the input, or give it more time."),
    ("bad_value", 422, "Value not allowed", "Nothing was sent; correct the value and try again."),
    (
        "trajectory_refused",
        422,
        "Path can't be followed",
        "Nothing was sent; `point`, `quantity`, `value` and `limit` say where it fails first.",
    ),
    (
        "not_ready",
        409,
        "Axis not ready",
        "The list `obstacles` names what prevents the command, and its remedy.",
    ),
    ("axis_busy", 409, "Axis busy", "Wait for the running operation, cancel it, or stop the axis."),
    (
        "axis_queue_full",
        503,
        "Too much waits for the axis",
        "Nothing was sent. Wait as Retry-After says, or cancel something that waits.",
    ),
    (
        "stop_latched",
        409,
        "Stop is latched",
        "When it is safe, POST /api/v1/stop/reset, then enable the axes.",
    ),
    ("guarded_object", 409, "Object is guarded", "Writing it could endanger motion; see `detail`."),
    ("axis_error", 409, "Axis refused", "Read the axis's status and readiness."),
    ("axis_fault", 409, "Drive in fault", "Remove the cause, POST reset-fault, then enable the axis again."),
    ("motion_failed", 502, "Motion failed", "Read the axis's status before you move it again."),
    ("motion_timeout", 504, "Motion did not end in time", "Read the axis's status; it was told to stop."),
    ("transition_timeout", 504, "Drive state not reached in time", "Read the axis's status, then try again."),
    ("node_error", 502, "Node error", "Read the node's status."),
    ("node_away", 503, "Node away", "Check its supply and cable; it is configured as soon as it answers."),
    ("wrong_identity", 503, "Other module than configured", "Correct the node's ID or model, or the module."),
    (
        "duplicate_node",
        503,
        "Two nodes with one ID",
        "Give one of them another ID, one at a time on the bus.",
    ),
    ("configuration_refused", 502, "Configuration refused", "Read the node's status; it names the object."),
    ("sdo_error", 502, "Object transfer failed", "Read the object before you write it again."),
    ("sdo_aborted", 502, "Node refused the transfer", "`abort_code` and `abort_meaning` say why."),
    ("sdo_timeout", 504, "No answer from the node", "The outcome is unknown: read before you write again."),
    ("sdo_queue_timeout", 504, "Node's queue did not move", "Nothing was sent. Read the node's status."),
    (
        "sdo_queue_full",
        503,
        "Node's queue is full",
        "Nothing was sent. Wait as Retry-After says.",
    ),
    ("sdo_protocol", 502, "Node broke the protocol", "Look for two nodes with one ID, or a second master."),
    ("bus_error", 503, "Bus error", "Check the interface, cable and bit rate; see GET /api/v1/bus."),
    ("bus_down", 503, "Bus is down", "Check the interface, cable and bit rate; see GET /api/v1/bus."),
    (
        "bus_overflow",
        503,
        "Bus takes no more frames",
        "Check the cable and terminators: nobody acknowledges.",
    ),
)

_WAITS = {
    "too_many_requests": 1.0,
    "key_in_flight": 1.0,
    "leased": 1.0,
    "too_many_streams": 5.0,
    "shutting_down": 5.0,
    "history_off": 5.0,
    "node_away": 5.0,  # it is looked for that often at least
    "bus_error": 5.0,
    "bus_down": 5.0,  # it is opened anew that often at least
    "bus_overflow": 1.0,
    "sdo_queue_full": 1.0,
}
"""Seconds after which it is worth to try again, for what passes by itself."""

PROBLEM_TYPES: Mapping[str, ProblemType] = {
    row[0]: ProblemType(*row, wait=_WAITS.get(row[0])) for row in _ROWS
}


class ApiError(Exception):
    """An error that the face itself finds; `code` is a row of the table."""

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        hint: str | None = None,
        retry_after: float | None = None,
        **extra: Any,
    ) -> None:
        super().__init__(detail)
        self.retry_after = retry_after
        self.type = PROBLEM_TYPES[code]
        self.detail = detail
        self.hint = hint
        self.extra = extra


class ProblemReply(NamedTuple):
    """What goes out: a status, and the members of the problem object."""

    status: int
    body: dict[str, Any]
    retry_after: float | None = None
    """Seconds after which it is worth to try again; None: waiting alone doesn't help."""


def problem(
    code: str, detail: str, *, hint: str | None = None, retry_after: float | None = None, **extra: Any
) -> ProblemReply:
    """Build a reply from a row of the table; members of `extra` that are None are left out."""
    row = PROBLEM_TYPES[code]
    body: dict[str, Any] = {
        "type": row.uri,
        "title": row.title,
        "status": row.status,
        "detail": detail,
        "code": row.code,
        "hint": hint or row.explanation,
    }
    body.update({key: value for key, value in extra.items() if value is not None})
    return ProblemReply(row.status, body, row.wait if retry_after is None else retry_after)


def of_api_error(error: ApiError) -> ProblemReply:
    """The reply for an error that the face found."""
    return problem(
        error.type.code, error.detail, hint=error.hint, retry_after=error.retry_after, **error.extra
    )


def of_driver_error(error: errors.CanaxisError) -> ProblemReply:
    """The reply for an error of the drivers, with all that it carries.

    A class of error that has no row of its own takes that of its nearest base.
    """
    extra: dict[str, Any] = {"node": error.node, "axis": error.axis, "sub": error.sub}
    if error.index is not None:
        extra["index"] = f"0x{error.index:04X}"
    if isinstance(error, errors.NotReady):
        extra["obstacles"] = [remedies.obstacle(o, error.node, error.axis) for o in error.obstacles]
    if isinstance(error, errors.TrajectoryRefused):
        extra |= {
            "point": error.point,
            "time_s": error.time_s,
            "quantity": error.quantity,
            "value": error.value,
            "limit": error.limit,
        }
    if isinstance(error, errors.SdoError):
        extra["outcome"] = error.outcome.value
    if isinstance(error, errors.RulesBroken):
        extra["errors"] = [
            {"field": rule.field, "message": rule.message, "rule": rule.rule} for rule in error.rules
        ]
    if isinstance(error, errors.SdoAborted):
        extra["abort_code"] = f"0x{error.abort_code:08X}"
        extra["abort_meaning"] = error.meaning
    return problem(_row_for(type(error)).code, error.message, hint=error.hint or None, **extra)


def _row_for(kind: type[errors.CanaxisError]) -> ProblemType:
    for base in kind.__mro__:
        row = PROBLEM_TYPES.get(cast("str", getattr(base, "code", "")))
        if row is not None:
            return row
    return PROBLEM_TYPES["error"]


def of_status(status: int, detail: str) -> ProblemReply:
    """The reply for an error that the web framework raised."""
    code = {404: "unknown_path", 405: "method_not_allowed", 413: "body_too_large"}.get(status)
    if code is not None:
        return problem(code, detail)
    try:
        title = HTTPStatus(status).phrase
    except ValueError:
        title = "Error"
    return ProblemReply(
        status,
        {
            "type": "about:blank",
            "title": title,
            "status": status,
            "detail": detail,
            "code": "http",
            "hint": "",
        },
    )
