"""Hold an axis, for as long as a person wants it: over a WebSocket, kept alive by a thread.

Needs the package `websockets`, which nothing else of the client does.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from canaxis import errors
from canaxis.reading import read
from canaxis.replies import Quantity

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
class _Hello:
    keep_alive_ms: int


@dataclass(frozen=True, slots=True)
class _Seen:
    """As much of an `ack` or a `status` as is shown."""

    jog: str
    position: Quantity | None
    velocity: Quantity | None
    round_trip_ms: float | None = None


class Jog:
    """A connection that can hold an axis. Use it in a `with`: leaving it lets go.

    While an axis is held a thread tells the service so, several times in the time for which a hold counts.
    Should this program end, hang as a whole, or lose its network, the axis stops by itself; should only its
    main thread hang, it does not: keep a hand on `release`.
    """

    def __init__(self, url: str, headers: Mapping[str, str]) -> None:
        """`url`: of the axis's jog, beginning with ws. Raises `CanaxisError`."""
        self._changed = threading.Condition(threading.RLock())
        self._sequence = 0
        self._wanted: dict[str, Any] | None = None
        self._due = 0.0
        self._stamp, self._stamped_at = 0.0, time.monotonic()
        self._seen = _Seen("idle", None, None)
        self._round_trip: float | None = None
        self._stopped: JogStopped | None = None
        self._problem: errors.CanaxisError | None = None
        self._used_up = False
        """Whether the press ended without its release."""
        self._over = False
        self._ends = contextlib.ExitStack()
        self._socket = _connect(url, headers, self._ends)
        try:
            hello = self._take(self._socket.recv(timeout=OPENING))
        except (TimeoutError, OSError, *_closed()) as error:
            self._ends.close()
            raise errors.ServiceUnreachable(f"The service doesn't say hello: {error}") from error
        if self._problem is not None:
            self._ends.close()
            raise self._problem
        self._each = read(_Hello, hello).keep_alive_ms / 1000
        self._thread = threading.Thread(target=self._run, name="canaxis jog", daemon=True)
        self._thread.start()

    def __enter__(self) -> Jog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def state(self) -> str:
        """idle, starting, turning, stopping or used_up; as the service last said."""
        return self._seen.jog

    @property
    def position(self) -> Quantity | None:
        """Where the axis is."""
        return self._seen.position

    @property
    def velocity(self) -> Quantity | None:
        """How fast it is; in the unit per second."""
        return self._seen.velocity

    @property
    def round_trip_ms(self) -> float | None:
        """The way to the service and back, as the service measured it with the last hold."""
        return self._round_trip

    @property
    def stopped(self) -> JogStopped | None:
        """How the last press ended; None while it is held or none was."""
        return self._stopped

    def hold(self, velocity: float, unit: str, acceleration: float | None = None) -> None:
        """Turn at `velocity` in `unit`/s, or go on with another, until `release`; answers at once.

        `acceleration` counts when a press begins. Raises why the service refused this press,
        `OperationCancelled` if it was ended (after either only `release` makes room for another), or
        `ServiceUnreachable` once the connection is gone.
        """
        with self._changed:
            self._check()
            if self._used_up and self._stopped is not None:
                raise errors.OperationCancelled(
                    self._stopped.detail, hint="Release, then hold again.", code=self._stopped.reason
                )
            if self._wanted is None:
                self._stopped = None
            self._wanted = {"velocity": velocity, "unit": unit, "acceleration": acceleration}
            self._say_hold()

    def release(self, timeout: float = STANDSTILL) -> JogStopped | None:
        """Let go, and wait for standstill: how the press ended, None if nothing had begun.

        Raises why the service refused the press, `ServiceUnreachable`, or `WaitTimeout`.
        """
        with self._changed:
            began = self._wanted is not None
            self._wanted = None
            self._send({"kind": "release"})
            ended = self._changed.wait_for(
                lambda: self._stopped is not None or self._problem is not None or self._over or not began,
                timeout,
            )
            self._used_up = False
            if self._stopped is None:
                self._check()
            if not ended:
                raise errors.WaitTimeout("The axis was not seen to stand.", hint="Look at its status.")
            return self._stopped

    def close(self) -> None:
        """Let go and close the connection; the axis ramps down, should it turn."""
        with contextlib.suppress(errors.CanaxisError):
            if self._wanted is not None:
                self.release()
        self._ends.close()
        self._thread.join(OPENING)

    # --- inside ---

    def _check(self) -> None:
        if self._problem is not None:
            problem = self._problem
            if not self._used_up:
                self._problem = None
            raise problem
        if self._over:
            raise errors.ServiceUnreachable(
                "The connection that jogs is closed; the axis ramps down.", hint="Open another."
            )

    def _say_hold(self) -> None:
        assert self._wanted is not None
        now = time.monotonic()
        self._sequence += 1
        self._due = now + self._each
        said = {name: value for name, value in self._wanted.items() if value is not None}
        age = (now - self._stamped_at) * 1000
        self._send(
            {
                "kind": "hold", "seq": self._sequence, "sent": now * 1000,
                "echo": self._stamp, "echo_age_ms": age, **said,
            }
        )  # fmt: skip

    def _send(self, message: Mapping[str, Any]) -> None:
        with contextlib.suppress(OSError, *_closed()):  # the thread sees that too
            self._socket.send(json.dumps(message))

    def _run(self) -> None:
        try:
            while True:
                with self._changed:
                    if self._wanted is not None and time.monotonic() >= self._due:
                        self._say_hold()
                    pause = self._each if self._wanted is None else self._due - time.monotonic()
                with contextlib.suppress(TimeoutError):
                    self._take(self._socket.recv(timeout=max(0.0, min(pause, self._each))))
        except (OSError, errors.BadReply, *_closed()):
            with self._changed:
                self._over = True
                self._wanted = None
                self._changed.notify_all()

    def _take(self, text: str | bytes) -> Mapping[str, Any]:
        """Understand a message."""
        try:
            said: Any = json.loads(text)
        except ValueError as error:
            raise errors.BadReply("The service sent what is no JSON.") from error
        with self._changed:
            self._stamp, self._stamped_at = float(said.get("stamp", 0)), time.monotonic()
            match said.get("kind"):
                case "ack":
                    self._seen = read(_Seen, said)
                    self._round_trip = self._seen.round_trip_ms
                case "status":
                    self._seen = read(_Seen, said)
                case "stopped":
                    self._stopped = read(JogStopped, said)
                    self._used_up = self._stopped.reason != "released"
                    self._wanted = None
                case "problem":
                    self._problem = errors.of_problem(said.get("problem", {}))
                    self._used_up = True
                    self._wanted = None
                case _:
                    pass  # hello, or newer than this client
            self._changed.notify_all()
        return said


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise errors.CanaxisError(
            "Jogging needs the package websockets, which is not installed.", hint="pip install websockets"
        ) from error


def _closed() -> tuple[type[Exception], ...]:
    return (_library("websockets.exceptions").ConnectionClosed,)


def _connect(url: str, headers: Mapping[str, str], ends: contextlib.ExitStack) -> Any:
    """An open connection that `ends` closes."""
    client = _library("websockets.sync.client")
    exceptions = _library("websockets.exceptions")
    try:
        connection = client.connect(
            url, additional_headers=dict(headers), compression=None, proxy=None, open_timeout=OPENING
        )
        return ends.enter_context(connection)
    except exceptions.InvalidStatus as error:
        raise errors.Forbidden(
            f"The service refuses the connection: {error}.",
            hint="Jogging needs a token with the role move.",
            status=error.response.status_code,
        ) from error
    except (OSError, exceptions.InvalidHandshake, exceptions.InvalidURI) as error:
        raise errors.ServiceUnreachable(f"No connection to {url}: {error}") from error
