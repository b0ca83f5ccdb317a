"""Homing: the methods of the modules, the outcome in a statusword, the start-bit handshake (manual §8)."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from drivers.cia402.power import Controlword, Statusword, decode_state, holding_controlword


class HomingSignal(enum.StrEnum):
    """What a homing method looks for."""

    NEGATIVE_LIMIT = "negative_limit"
    POSITIVE_LIMIT = "positive_limit"
    HOME_SWITCH = "home_switch"
    INDEX = "index"


@dataclass(frozen=True, slots=True)
class HomingMethod:
    """One value of 6098h."""

    number: int
    title: str
    description: str
    uses: frozenset[HomingSignal] = frozenset()
    """The signals without which it can't succeed. Index needs an encoder."""
    moves: bool = True
    """Whether the motor turns; if not, OPERATION_ENABLED is not needed."""


_S: Final = HomingSignal
_METHODS: Final = (
    HomingMethod(0, "No homing", "Nothing is searched and nothing changes.", moves=False),
    HomingMethod(
        1,
        "Negative limit switch and index",
        "Goes negative to the limit switch, back until the switch opens, and on to the first index pulse.",
        frozenset((_S.NEGATIVE_LIMIT, _S.INDEX)),
    ),
    HomingMethod(
        2,
        "Positive limit switch and index",
        "Goes positive to the limit switch, back until the switch opens, and on to the first index pulse.",
        frozenset((_S.POSITIVE_LIMIT, _S.INDEX)),
    ),
    HomingMethod(
        3,
        "Positive edge of the home switch and index",
        "Finds the home switch's edge, first going where the switch's state asks for, then an index pulse.",
        frozenset((_S.HOME_SWITCH, _S.INDEX)),
    ),
    HomingMethod(
        5,
        "Negative edge of the home switch and index",
        "As method 3, for a switch that is closed on the other side.",
        frozenset((_S.HOME_SWITCH, _S.INDEX)),
    ),
    HomingMethod(
        17,
        "Negative limit switch",
        "Goes negative to the limit switch and back; home is where the switch opens.",
        frozenset((_S.NEGATIVE_LIMIT,)),
    ),
    HomingMethod(
        18,
        "Positive limit switch",
        "Goes positive to the limit switch and back; home is where the switch opens.",
        frozenset((_S.POSITIVE_LIMIT,)),
    ),
    HomingMethod(
        19,
        "Positive edge of the home switch",
        "Home is where the home switch changes; a limit switch met on the way turns the search round.",
        frozenset((_S.HOME_SWITCH,)),
    ),
    HomingMethod(
        21,
        "Negative edge of the home switch",
        "As method 19, for a switch that is closed on the other side.",
        frozenset((_S.HOME_SWITCH,)),
    ),
    HomingMethod(
        33,
        "Next index, negative",
        "Goes negative to the next index pulse.",
        frozenset((_S.INDEX,)),
    ),
    HomingMethod(
        34,
        "Next index, positive",
        "Goes positive to the next index pulse.",
        frozenset((_S.INDEX,)),
    ),
    HomingMethod(
        35,
        "Here",
        "The present position becomes home without a move; the axis need not be enabled.",
        moves=False,
    ),
)

HOMING_METHODS: Final[Mapping[int, HomingMethod]] = MappingProxyType({m.number: m for m in _METHODS})
"""The methods of the TMCM-3216 (manual §8.1); a profile says which of them its module has."""


class HomingOutcome(enum.Enum):
    """What bits 10 and 12 of a statusword say in homing mode."""

    RUNNING = "running"
    """Neither found nor stopped. A search that never ends looks like this for ever: set a deadline."""
    ATTAINED = "attained"
    """Bits 10 and 12: home was found."""
    STOPPED = "stopped"
    """Bit 10 alone: the search was ended by lowering controlword bit 4."""


def outcome(statusword: int) -> HomingOutcome:
    """What one statusword says, be it of this homing or still of the one before: see `HomingHandshake`."""
    if not statusword & Statusword.TARGET_REACHED:
        return HomingOutcome.RUNNING
    return HomingOutcome.ATTAINED if statusword & Statusword.BIT12 else HomingOutcome.STOPPED


class HomingHandshake:
    """Starts a homing and says when a statusword shows its outcome rather than an old one.

    Bits 10 and 12 may still show the previous homing, or the "target reached" of another mode, when a homing
    starts, and whether the module clears them at the start is unverified on hardware. So:

    - an outcome other than the one before `start` counts, and so does any outcome after that;
    - an ATTAINED that never went away counts when the motor turned and has been at rest for `grace_s` since,
      and for a method that does not move (35) after `grace_s`; otherwise it is the old one, and RUNNING is
      said until the caller's deadline. After `stop` it counts as STOPPED;
    - STOPPED, with the motor at rest, takes two of: something happened, `stop` was called, it has lasted
      for `grace_s`. Bit 10 may come a statusword before bit 12.

    `now` is seconds on any one monotonic clock. `grace_s` must be longer than a statusword can be old. Feed
    the last statusword again when none comes: time alone can decide.
    """

    def __init__(self, *, moves: bool, grace_s: float) -> None:
        self._moves: Final = moves
        self._grace_s: Final = grace_s
        self._before: HomingOutcome = HomingOutcome.RUNNING
        self._changed = False
        self._turned = False
        self._stop_asked = False
        self._shown: HomingOutcome = HomingOutcome.RUNNING
        self._shown_since = 0.0
        self._hold = Controlword.ENABLE_OPERATION

    @property
    def began(self) -> bool:
        """Whether anything has shown that the drive took the start."""
        return self._changed or self._turned

    @property
    def release_controlword(self) -> int:
        """The controlword that lowers bit 4, after the end or to stop; the drive keeps its last state."""
        return self._hold

    def start(self, statusword: int, now: float) -> int:
        """The controlword that starts. `statusword` is the last one from before, in homing mode already.

        It keeps the drive in the state that it is in, since method 35 runs without being enabled.
        """
        self._before = self._shown = outcome(statusword)
        self._shown_since = now
        self._changed = self._turned = self._stop_asked = False
        self._note_state(statusword)
        return self._hold | Controlword.START_HOMING

    def stop(self) -> int:
        """The controlword that stops the search; the outcome says whether home was found before."""
        self._stop_asked = True
        return self._hold

    def feed(self, statusword: int, now: float) -> HomingOutcome:
        """The outcome of the homing that `start` began, as far as this statusword tells."""
        self._note_state(statusword)
        shown = outcome(statusword)
        turning = bool(statusword & Statusword.MOTOR_ACTIVITY)
        if turning or shown is not self._shown:
            self._shown_since = now
        self._shown = shown
        self._turned |= turning
        self._changed |= shown is not self._before
        lasted = not turning and now - self._shown_since >= self._grace_s
        if shown is HomingOutcome.ATTAINED:
            return self._attained(lasted=lasted)
        if shown is HomingOutcome.STOPPED and not turning:
            return self._stopped(lasted=lasted)
        return HomingOutcome.RUNNING

    def _attained(self, *, lasted: bool) -> HomingOutcome:
        if self._changed:
            return HomingOutcome.ATTAINED
        if not lasted:
            return HomingOutcome.RUNNING
        if self._stop_asked:
            return HomingOutcome.STOPPED
        return HomingOutcome.ATTAINED if self._turned or not self._moves else HomingOutcome.RUNNING

    def _stopped(self, *, lasted: bool) -> HomingOutcome:
        reasons = (self.began, self._stop_asked, lasted)
        return HomingOutcome.STOPPED if sum(reasons) >= 2 else HomingOutcome.RUNNING

    def _note_state(self, statusword: int) -> None:
        state = decode_state(statusword)
        if state is not None:
            self._hold = holding_controlword(state)
