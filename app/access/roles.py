"""Who may do what: four roles, each of which includes those before it, and THE table of commands."""

from __future__ import annotations

import enum

from starlette.routing import compile_path

from app.http.paths import API, SAFE_METHODS

WEBSOCKET = "WEBSOCKET"
"""Stands for a method in the table, where the request is for a WebSocket."""


class Role(enum.IntEnum):
    """What a token entitles to."""

    READ = 1
    """Look at everything."""
    STOP = 2
    """Stop axes, end operations."""
    MOVE = 3
    """Enable, disable, home and move axes, acknowledge faults, release a latched stop."""
    CONFIGURE = 4
    """Write objects; whatever the table doesn't name."""

    @property
    def word(self) -> str:
        """As it is written in settings, token files and replies."""
        return self.name.lower()


ROLES = {role.word: role for role in Role}

_AXIS = f"{API}/nodes/{{node}}/axes/{{axis}}"
COMMANDS: tuple[tuple[str, str, Role], ...] = (
    ("POST", f"{API}/stop", Role.STOP),
    ("POST", f"{_AXIS}/stop", Role.STOP),
    ("POST", f"{_AXIS}/quick-stop", Role.STOP),
    ("POST", f"{API}/operations/{{id}}/cancel", Role.STOP),  # a controlled stop of what the operation moves
    ("POST", f"{_AXIS}/move", Role.MOVE),
    ("POST", f"{API}/moves", Role.MOVE),
    ("POST", f"{_AXIS}/velocity", Role.MOVE),
    ("POST", f"{API}/trajectories", Role.MOVE),
    ("POST", f"{_AXIS}/home", Role.MOVE),
    ("POST", f"{_AXIS}/set-position", Role.MOVE),
    (WEBSOCKET, f"{_AXIS}/jog", Role.MOVE),
    ("POST", f"{_AXIS}/enable", Role.MOVE),
    ("POST", f"{_AXIS}/disable", Role.MOVE),  # it takes the holding torque away
    ("POST", f"{_AXIS}/reset-fault", Role.MOVE),
    ("POST", f"{API}/leases", Role.MOVE),  # `force` too: it is audited, and a stop needs no lease
    ("POST", f"{API}/leases/{{id}}/renew", Role.MOVE),
    ("POST", f"{API}/leases/{{id}}/release", Role.MOVE),
    ("DELETE", f"{API}/leases/{{id}}", Role.MOVE),
    ("POST", f"{API}/stop/reset", Role.MOVE),  # after it, axes may move again
    ("POST", f"{API}/tickets", Role.READ),  # a ticket is never worth more than the token it was asked with
    ("POST", f"{API}/nodes/{{node}}/boot", Role.CONFIGURE),  # writes the node's parameters anew
    ("POST", f"{API}/nodes/{{node}}/verify-failsafe", Role.CONFIGURE),  # lets an enabled axis fault
    ("PUT", f"{_AXIS}/positions/{{name}}", Role.MOVE),
    ("DELETE", f"{_AXIS}/positions/{{name}}", Role.MOVE),
    ("POST", f"{API}/nodes/{{node}}/outputs/{{output}}", Role.MOVE),  # whatever hangs on it may move
    ("POST", f"{API}/nodes/{{node}}/waits", Role.MOVE),
    ("PATCH", f"{_AXIS}/settings", Role.CONFIGURE),
    ("POST", f"{API}/settings/diff", Role.READ),  # reads only
    ("POST", f"{API}/settings/apply", Role.CONFIGURE),
    ("POST", f"{API}/settings/rollback", Role.CONFIGURE),
    ("POST", f"{API}/nodes/{{node}}/store", Role.CONFIGURE),
    ("POST", f"{API}/nodes/{{node}}/restore-defaults", Role.CONFIGURE),
    ("PUT", f"{API}/nodes/{{node}}/objects/{{index}}/{{sub}}", Role.CONFIGURE),
)
"""Every command of the API with the least role that may give it. What is missing here needs CONFIGURE."""

_PATTERNS = tuple((method, compile_path(path)[0], role) for method, path, role in COMMANDS)
_STOP_ENDS = ("/stop", "/quick-stop")
_STOPS = tuple(
    compile_path(path)[0] for _, path, role in COMMANDS if role is Role.STOP and path.endswith(_STOP_ENDS)
)
_CANCEL = compile_path(f"{API}/operations/{{id}}/cancel")[0]
_ONLY_LOOKS = frozenset({f"{API}/nodes/{{node}}/waits"})
"""Commands about a node or an axis that move and change nothing."""
DRY_RUNS = frozenset(
    {f"{_AXIS}/move", f"{_AXIS}/velocity", f"{_AXIS}/home", f"{API}/moves", f"{API}/trajectories"}
)
"""Commands that `dry_run` makes a look."""


def role_for(method: str, path: str) -> Role:
    """The least role that a request needs."""
    if method in SAFE_METHODS:
        return Role.READ
    for listed, pattern, role in _PATTERNS:
        if listed == method and pattern.match(path):
            return role
    return Role.CONFIGURE


def needs_lease(method: str, template: str) -> bool:
    """Whether a request to a route about a node or an axis is a command that others' leases forbid.

    `template` is the route's path, not the request's: an axis may be called `stop`.
    """
    return method not in SAFE_METHODS and not is_stop(template) and template not in _ONLY_LOOKS


def is_dry_run(template: str, dry_run: str | None) -> bool:
    """Whether a request to a route, with this `dry_run` in its query, only looks.

    What the route itself might take for "no" must not count as "yes" here.
    """
    return template in DRY_RUNS and dry_run is not None and dry_run.lower() in ("true", "1")


def is_stop(path: str) -> bool:
    """Whether a path, or its template, stops something: one axis, or everything.

    Nothing may hold such a request back. What is merely called so (a position `stop`) is none.
    """
    return path.endswith(_STOP_ENDS) and any(pattern.match(path) for pattern in _STOPS)


def is_cancel(path: str) -> bool:
    """Whether a path, or its template, ends an operation: a controlled stop of what it moves."""
    return path.endswith("/cancel") and _CANCEL.match(path) is not None
