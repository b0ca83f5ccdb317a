"""Holding an axis, without I/O: what is said over the WebSocket of a jog and when, and what was heard.

Every `now` is a time of the same monotonic clock, in seconds; every message is a text to be sent as it is.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from canaxis.contract.reading import read
from canaxis.errors import (
    BadReply,
    CanaxisError,
    OperationCancelled,
    ServiceUnreachable,
    WaitTimeout,
    of_problem,
)
from canaxis.replies.quantity import Quantity

OPENING = 5.0
"""Seconds that the connection may take to come about."""
STANDSTILL = 30.0
"""Seconds that `release` waits for standstill."""


@dataclass(frozen=True, slots=True)
class JogStopped:
    """A press has ended, and the axis with it."""

    reason: str
    """released, silence, lease, limit, stop, fault, failed or shutdown."""
    detail: str
    hint: str
    operation: str | None
    """The path of its operation; None if it was let go before the axis began."""
    result: Mapping[str, Any] | None


@dataclass(frozen=True, slots=True)
class Seen:
    """As much of an `ack` or a `status` as is shown."""

    jog: str
    position: Quantity | None
    velocity: Quantity | None
    round_trip_ms: float | None = None


@dataclass(frozen=True, slots=True)
class _Hello:
    keep_alive_ms: int


class Press:
    """One connection's presses, one after the other: what is wanted, and what the service made of it."""

    def __init__(self) -> None:
        self.seen = Seen("idle", None, None)
        self.round_trip_ms: float | None = None
        self.stopped: JogStopped | None = None
        """How the last press ended; None while it is held or none was."""
        self._each = 0.0
        """Seconds between two messages that say that it is held."""
        self._sequence = 0
        self._wanted: dict[str, Any] | None = None
        self._due = 0.0
        self._stamp, self._stamped_at = 0.0, 0.0
        self._problem: CanaxisError | None = None
        self._used_up = False
        """Whether the press ended without its release."""
        self._owed = False
        """Whether a press was let go whose end was not told yet."""
        self._open = False

    @property
    def held(self) -> bool:
        """Whether the axis is to turn."""
        return self._wanted is not None

    @property
    def settled(self) -> bool:
        """Whether a release has nothing more to wait for."""
        return self.stopped is not None or self._problem is not None or not self._open or not self._owed

    def greet(self, text: str | bytes, now: float) -> None:
        """Understand the first message; the connection counts as open from then on.

        Raises why the service refuses it, or `BadReply`.
        """
        hello = self.hear(text, now)
        if self._problem is not None:
            raise self._problem
        self._each = read(_Hello, hello).keep_alive_ms / 1000
        self._open = True

    def hold(self, velocity: float, unit: str, acceleration: float | None, now: float) -> str:
        """Want a speed from now on. Raises why there is no such press (see `Jog.hold`)."""
        self._check()
        if self._used_up and self.stopped is not None:
            raise OperationCancelled(
                self.stopped.detail, hint="Release, then hold again.", code=self.stopped.reason
            )
        if self._wanted is None:
            self.stopped = None
            self._owed = False
        self._wanted = {"velocity": velocity, "unit": unit, "acceleration": acceleration}
        return self._hold(self._wanted, now)

    def due(self, now: float) -> str | None:
        """What has to be said by now so that the hold goes on counting; None: nothing."""
        if self._wanted is None or now < self._due:
            return None
        return self._hold(self._wanted, now)

    def pause(self, now: float) -> float:
        """Seconds until something may be due."""
        pause = self._each if self._wanted is None else self._due - now
        return max(0.0, min(pause, self._each))

    def release(self) -> str:
        """Want nothing more; `settled` says when that has come to its end, `ended` which one."""
        self._owed |= self._wanted is not None
        self._wanted = None
        return json.dumps({"kind": "release"})

    def ended(self) -> JogStopped | None:
        """How the press that was let go has ended. Raises why it was refused, or that no end was seen."""
        settled, self._used_up = self.settled, False
        self._owed &= not settled
        if self.stopped is None:
            self._check()
        if not settled:
            raise WaitTimeout("The axis was not seen to stand.", hint="Look at its status.")
        return self.stopped

    def hear(self, text: str | bytes, now: float) -> Mapping[str, Any]:
        """Understand a message. Raises `BadReply`."""
        said = _object(text)
        self._stamp, self._stamped_at = float(said.get("stamp", 0)), now
        match said.get("kind"):
            case "ack":
                self.seen = read(Seen, said)
                self.round_trip_ms = self.seen.round_trip_ms
            case "status":
                self.seen = read(Seen, said)
            case "stopped":
                self.stopped = read(JogStopped, said)
                self._used_up = self.stopped.reason != "released"
                self._wanted = None
            case "problem":
                self._problem = of_problem(said.get("problem", {}))
                self._used_up = True
                self._wanted = None
            case _:
                pass  # hello, or newer than this client
        return said

    def close(self) -> None:
        """The connection is gone, or is to go: nothing is held any more."""
        self._open = False
        self._wanted = None

    def _check(self) -> None:
        if self._problem is not None:
            problem = self._problem
            if not self._used_up:
                self._problem = None
            raise problem
        if not self._open:
            raise ServiceUnreachable(
                "The connection that jogs is closed; the axis ramps down.", hint="Open another."
            )

    def _hold(self, wanted: Mapping[str, Any], now: float) -> str:
        self._sequence += 1
        self._due = now + self._each
        message: dict[str, Any] = {
            "kind": "hold",
            "seq": self._sequence,
            "sent": now * 1000,
            "echo": self._stamp,
            "echo_age_ms": (now - self._stamped_at) * 1000,
            **{name: value for name, value in wanted.items() if value is not None},
        }
        return json.dumps(message)


def _object(text: str | bytes) -> dict[str, Any]:
    try:
        said: object = json.loads(text)
    except ValueError as error:
        raise BadReply("The service sent what is no JSON.") from error
    if not isinstance(said, dict):
        raise BadReply("The service sent what is no JSON object.")
    return cast("dict[str, Any]", said)
