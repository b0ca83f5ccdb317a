# Made by `make client` from canaxis/asynchronous/jog.py: change that.
"""Hold an axis, for as long as a person wants it: over a WebSocket, kept alive by a thread of its own."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from types import TracebackType

from canaxis.blocking.waiting import Background, Changed, Opening, Socket
from canaxis.contract.press import OPENING, STANDSTILL, JogStopped, Press
from canaxis.errors import BadReply, CanaxisError, ServiceUnreachable
from canaxis.replies.quantity import Quantity
from canaxis.websocket import Closed


class Jog(Opening):
    """A connection that can hold an axis. Use it in a `with`: leaving it lets go.

    While an axis is held a thread tells the service so, several times in the time for which a hold counts.
    Should this program end, hang as a whole, or lose its network, the axis stops by itself; should only the
    thread that wanted it hang, it does not: keep a hand on `release`.
    """

    def __init__(self, url: str, headers: Mapping[str, str]) -> None:
        """`url`: of the axis's jog, beginning with ws. Raises `CanaxisError`."""
        self._url = url
        self._headers = headers
        self._press = Press()
        self._changed = Changed()
        self._socket = Socket()
        self._attending = Background(self._attend, name="canaxis jog")
        super().__init__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def state(self) -> str:
        """idle, starting, turning, stopping or used_up; as the service last said."""
        return self._press.seen.jog

    @property
    def position(self) -> Quantity | None:
        """Where the axis is."""
        return self._press.seen.position

    @property
    def velocity(self) -> Quantity | None:
        """How fast it is; in the unit per second."""
        return self._press.seen.velocity

    @property
    def round_trip_ms(self) -> float | None:
        """The way to the service and back, as the service measured it with the last hold."""
        return self._press.round_trip_ms

    @property
    def stopped(self) -> JogStopped | None:
        """How the last press ended; None while it is held or none was."""
        return self._press.stopped

    def hold(self, velocity: float, unit: str, acceleration: float | None = None) -> None:
        """Turn at `velocity` in `unit`/s, or go on with another, until `release`; answers at once.

        `acceleration` counts when a press begins. Raises why the service refused this press,
        `OperationCancelled` if it was ended (after either only `release` makes room for another), or
        `ServiceUnreachable` once the connection is gone.
        """
        with self._changed:
            self._say(self._press.hold(velocity, unit, acceleration, time.monotonic()))

    def release(self, timeout: float = STANDSTILL) -> JogStopped | None:
        """Let go, and wait for standstill: how the press ended, None if nothing had begun.

        Raises why the service refused the press, `ServiceUnreachable`, or `WaitTimeout`.
        """
        with self._changed:
            self._say(self._press.release())
            self._changed.wait_for(lambda: self._press.settled, timeout)
            return self._press.ended()

    def close(self) -> None:
        """Let go and close the connection; the axis ramps down, should it turn."""
        try:
            with contextlib.suppress(CanaxisError):
                if self._press.held:
                    self.release()
        finally:
            self._press.close()  # also where the waiting was cut off: nobody says any more that it is held
            try:
                self._socket.close()
            finally:
                self._attending.end(OPENING)

    # --- inside ---

    def _open(self) -> None:
        self._socket.open(self._url, self._headers, OPENING)
        try:
            self._press.greet(self._socket.receive(OPENING), time.monotonic())
        except (TimeoutError, Closed) as error:
            self._socket.close()
            raise ServiceUnreachable(f"The service doesn't say hello: {error}") from error
        except BaseException:
            self._socket.close()
            raise
        self._attending.start()

    def _say(self, message: str | None) -> None:
        with contextlib.suppress(Closed):  # who attends to it sees that too
            if message is not None:
                self._socket.send(message)

    def _attend(self) -> None:
        """Say in time that the axis is held, and hear the service, until the connection is gone."""
        try:
            while True:
                with self._changed:
                    self._say(self._press.due(time.monotonic()))
                    pause = self._press.pause(time.monotonic())
                with contextlib.suppress(TimeoutError):
                    self._hear(self._socket.receive(pause))
        except (Closed, BadReply):
            with self._changed:
                self._press.close()
                self._changed.notify_all()

    def _hear(self, text: str | bytes) -> None:
        with self._changed:
            self._press.hear(text, time.monotonic())
            self._changed.notify_all()
