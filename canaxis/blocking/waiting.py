"""Waiting as plain Python has it: threads, their lock, their socket.

All that is not the same in both clients; `canaxis.asynchronous.waiting` has the same names. Written by hand.
"""

from __future__ import annotations

import abc
import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Self

from canaxis.websocket import Closed, in_use, library, opening, options

Sleep = Callable[[float], None]
sleep: Sleep = time.sleep


class Opening(abc.ABC):
    """What is opened as it is made; entering its `with` does nothing more."""

    def __init__(self) -> None:
        self._open()

    @abc.abstractmethod
    def _open(self) -> None: ...

    def __enter__(self) -> Self:
        return self


class Background(threading.Thread):
    """Something that is done beside what the program does: by a thread, which doesn't keep it alive."""

    def __init__(self, work: Callable[[], None], *, name: str) -> None:
        super().__init__(target=work, name=name, daemon=True)
        self._over = threading.Event()

    def pause(self, seconds: float) -> bool:
        """For the work itself: wait; whether to go on then."""
        return not self._over.wait(seconds)

    def end(self, within: float | None = None) -> None:
        """Have it end at its next pause, and wait for that: at most `within` seconds."""
        self._over.set()
        self.join(within)


class Changed(threading.Condition):
    """A lock, and waiting for what others change under it: `wait_for` at most its `timeout` in seconds."""


class Socket:
    """A WebSocket."""

    def __init__(self) -> None:
        self._connection: Any = None
        self._ends = contextlib.ExitStack()

    def open(self, url: str, headers: Mapping[str, str], within: float) -> None:
        """Connect, within some seconds. Raises `CanaxisError`."""
        with opening(url):
            connecting = library("websockets.sync.client").connect(url, **options(headers, within))
            self._connection = self._ends.enter_context(connecting)

    def send(self, text: str) -> None:
        """Send a message. Raises `Closed`."""
        if self._connection is None:
            raise Closed("It was not opened.")
        with in_use():
            self._connection.send(text)

    def receive(self, timeout: float) -> str | bytes:
        """The next message. Raises TimeoutError after `timeout` seconds, and `Closed`."""
        with in_use():
            return self._connection.recv(timeout=timeout)

    def close(self) -> None:
        """Close it, if it was opened."""
        self._ends.close()
