"""A `Station` in a thread of its own, for programs and tests that have no event loop, or block theirs."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from drivers.sim.panel import COMMANDS
from drivers.sim.snapshot import ModuleSnapshot
from drivers.sim.station import Listen, Station

T = TypeVar("T")

PATIENCE: Final = 10.0
"""Seconds that the thread gets for one call, and to start or end."""


class BackgroundPanel:
    """The hands on one module of a `BackgroundStation`, from any other thread."""

    def __init__(self, background: BackgroundStation, node_id: int) -> None:
        self._background = background
        self._node_id = node_id

    def perform(self, command: str, **arguments: object) -> None:
        """Do what a command of `drivers.sim.panel.COMMANDS` says: ``perform("block", axis=0)``.

        Raises `BadValue` for an unknown command or argument, `UnknownNode` for a module that is not there.
        """
        self._background.call(lambda station: station.panel(self._node_id).perform(command, arguments))

    def state(self) -> ModuleSnapshot:
        """What there is to see now."""
        return self._background.call(lambda station: station.panel(self._node_id).state())

    def clear(self) -> None:
        """Undo everything; see `ModulePanel.clear`."""
        self._background.call(lambda station: station.panel(self._node_id).clear())

    @property
    def commands(self) -> tuple[str, ...]:
        """The names that `perform` knows."""
        return tuple(COMMANDS)


class BackgroundStation:
    """Runs a station, with a socketcand server on `host` and `port`, while it is entered (``with``).

    It lives in real time. Other programs, and blocking libraries in this one, join with python-can's
    ``socketcand`` interface and channel ``can0``.
    """

    def __init__(self, build: Callable[[Listen], Station] | None = None) -> None:
        """Make one; `build` makes the station in its thread, to listen where it is told."""
        self._build = build if build is not None else _one_module
        self._ready: Future[tuple[Station, asyncio.AbstractEventLoop, asyncio.Event]] = Future()
        self._thread = threading.Thread(target=self._run, name="simulated modules", daemon=True)
        self._listen = Listen()

    @property
    def host(self) -> str:
        """Where the server listens: a loopback address."""
        return self._listen.host

    @property
    def port(self) -> int:
        """The server's TCP port; 0 before it runs."""
        return self._listen.port

    @property
    def channel(self) -> str:
        """The channel that the server knows."""
        return "can0"

    def panel(self, node_id: int = 1) -> BackgroundPanel:
        """The hands on a module."""
        return BackgroundPanel(self, node_id)

    def call(self, act: Callable[[Station], T]) -> T:
        """Have `act` called with the station in its own thread, and give what it returns, or raises."""
        station, loop, _ = self._ready.result(0)
        outcome: Future[T] = Future()

        def there() -> None:
            try:
                outcome.set_result(act(station))
            except BaseException as error:
                outcome.set_exception(error)

        loop.call_soon_threadsafe(there)
        return outcome.result(PATIENCE)

    def run(self, act: Callable[[Station], Coroutine[Any, Any, T]]) -> T:
        """As `call`, for a coroutine: ``run(lambda station: station.remove(1))``."""
        station, loop, _ = self._ready.result(0)
        return asyncio.run_coroutine_threadsafe(act(station), loop).result(PATIENCE)

    def __enter__(self) -> Self:
        """Start it. Raises what the station raises."""
        self._thread.start()
        station, _, _ = self._ready.result(PATIENCE)
        if station.server is not None:
            self._listen = self._listen._replace(port=station.server.port)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        _, loop, end = self._ready.result(0)
        loop.call_soon_threadsafe(end.set)
        self._thread.join(PATIENCE)

    def _run(self) -> None:
        try:
            asyncio.run(self._live())
        except BaseException as error:
            if self._ready.done():
                raise
            self._ready.set_exception(error)

    async def _live(self) -> None:
        end = asyncio.Event()
        async with self._build(self._listen) as station:
            self._ready.set_result((station, asyncio.get_running_loop(), end))
            await end.wait()


def _one_module(listen: Listen) -> Station:
    return Station(listen=listen)
