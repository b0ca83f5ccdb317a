"""THE table of what can stand in a command's way: every code, what to do about it, and how grave it is.

What prevents the commands of an axis has its conditions beside it, in the order in which it is best taken
away: `drivers.master.axis.obstacle_rows`. All others are here, and found in one place each, which says what
is the matter there. A code comes several times where more than one thing helps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from drivers.errors import Gravity, Obstacle, Remedy


@dataclass(frozen=True, slots=True)
class ObstacleKind:
    """What is always the same about an obstacle."""

    code: str
    """Stable name in snake_case, e.g. ``not_enabled``."""
    remedy: str
    """What to do about it, as a sentence; ``{name}`` is a blank that is filled in where it is found."""
    action: Remedy | None = None
    """The command that does it; None: it takes waiting, or a person's hands."""
    gravity: Gravity = Gravity.ORDINARY

    def found(self, message: str, **blanks: object) -> Obstacle:
        """The obstacle, where something is the matter: `message` says what, as a sentence."""
        remedy = self.remedy.format(**blanks) if blanks else self.remedy
        return Obstacle(self.code, message, remedy, self.action, self.gravity)


# --- the service, the bus ---

CLOSING: Final = ObstacleKind("closing", "Start the service again.")
CLOSES: Final = "The service is shutting down."
"""What is the matter then."""
STOP_LATCHED_FOR_OUTPUTS: Final = ObstacleKind(
    "stop_latched",
    "When it is safe, reset the stop (POST /api/v1/stop/reset). Off is always allowed.",
    gravity=Gravity.LATCHED,
)
SYNC_IN_USE: Final = ObstacleKind("sync_in_use", "Wait until that has ended, or stop it.")
SET_POINT_WAITS: Final = ObstacleKind(
    "set_point_waits", "Bring the node back, or switch it off and on: what waits is made harmless then."
)

# --- a node ---

IN_USE: Final = ObstacleKind("in_use", "Disable every axis of the node first.")
TOO_MANY_WAITS: Final = ObstacleKind("too_many_waits", "Cancel one, or wait.")
NOT_AN_OUTPUT: Final = ObstacleKind(
    "not_an_output", "If nothing drives that pin, set bit {bit} of 2711h with every axis disabled."
)
USED_BY_BRAKE: Final = ObstacleKind(
    "used_by_brake", "Leave it to the brake; or set 200Ch:1 and 200Ch:2 of that axis to 0, disabled."
)
AWAY_FOR_CHECK: Final = ObstacleKind("node_away", "Wait until the node is operational.", gravity=Gravity.AWAY)
CHECK_RUNS: Final = ObstacleKind("busy", "Wait until it has ended.", gravity=Gravity.BUSY)
NOTHING_TO_CHECK: Final = ObstacleKind("not_enabled", "Enable one of the node's axes.")
AXIS_DISTURBS_CHECK: Final = ObstacleKind("busy", "Stop every axis first.", gravity=Gravity.BUSY)

# --- one command of an axis ---

QUEUE_FULL: Final = ObstacleKind("queue_full", "Wait until one of them has begun, or cancel some.")
ENDLESS: Final = ObstacleKind(
    "endless", "Replace it, stop the axis, or give the velocity an end.", Remedy.STOP, Gravity.BUSY
)
SUPERSEDED: Final = ObstacleKind("superseded", "Give the command again if it is still wanted.")
BEYOND_LIMITS: Final = ObstacleKind("beyond_limits", "Choose a target within the limits.")
LIMITS_WOULD_SHIFT: Final = ObstacleKind(
    "limits_would_shift",
    "Home the axis instead; or send shift_limits true if the new position is where it really stands.",
)
NO_CSP: Final = ObstacleKind("no_csp", "Use moves instead.")
DISABLE_TO_CHANGE: Final = ObstacleKind("disable_first", "Disable the axis (POST disable) first.")
DISABLE_TO_CLAIM: Final = ObstacleKind("disable_first", "Disable the axis, then enable it again.")

# --- what the service remembers ---

SETTINGS_CHANGED: Final = ObstacleKind("settings_changed", "Send the path again.")
STALE_FOR_TEACHING: Final = ObstacleKind("status_stale", "Wait a moment.")
TURNING_AT_TEACHING: Final = ObstacleKind(
    "turning", "Stop it, or wait until it stands.", gravity=Gravity.BUSY
)
NOT_REFERENCED_FOR_TEACHING: Final = ObstacleKind(
    "not_referenced", "Home the axis, or send unreferenced true."
)
NOT_REFERENCED_FOR_GOING: Final = ObstacleKind(
    "not_referenced", "Home the axis, or teach the position anew with unreferenced true."
)

# --- the simulated module ---

STANDING: Final = ObstacleKind("standing", "Move the axis first.")
