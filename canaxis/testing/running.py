"""`canaxis simulate` and `canaxis serve`, started for tests; the fixtures are made of these."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import httpx

from canaxis.blocking.client import Client
from canaxis.testing.panel import Panel
from canaxis.testing.processes import CanaxisProcess, NotStarted

STARTING: Final = 60.0
"""Seconds that each may take to start, and then the service to have its modules configured."""
ANSWERING: Final = 10.0
"""Seconds that the fault panel may take to answer."""
LOOKING: Final = 0.05
"""Seconds between two looks at whether the service is ready."""
PATIENT: Final = {"consumer_ms": 10_000, "node_heartbeat_ms": 3000}
"""Heartbeats of the service's network: a machine that is short of time must not look like a lost module."""


@dataclass(frozen=True, slots=True)
class SimulatedPort:
    """Simulated modules on a bus that any program can join through a socketcand server."""

    host: str
    """Where the server listens: a loopback address."""
    port: int
    """The server's TCP port."""
    nodes: tuple[int, ...]
    """The node IDs."""
    panel_url: str
    """Where the fault panel is; its documentation is at ``/docs`` there."""
    _process: CanaxisProcess
    _http: httpx.Client

    @property
    def channel(self) -> str:
        """The channel that the server knows."""
        return "can0"

    @property
    def output(self) -> str:
        """All that the simulator printed so far."""
        return self._process.output

    def panel(self, node: int = 1) -> Panel:
        """The hands on a module."""
        return Panel(self._http, node)


@dataclass(frozen=True, slots=True)
class RunningService:
    """A service that can command its modules."""

    url: str
    """Its address, for a `Client` or a browser."""
    client: Client
    """One client of it, closed with it. Others can be made with `url`."""
    _process: CanaxisProcess

    @property
    def output(self) -> str:
        """All that it printed so far, its log included."""
        return self._process.output


@contextmanager
def simulate(*nodes: int, model: str = "TMCM-3216") -> Generator[SimulatedPort]:
    """New simulated modules, node 1 alone if none is named, in a process that ends with the `with`.

    For fixtures of your own, where one process shall do for a whole module or session of tests. Raises
    `NotStarted` with what the process said.
    """
    ids = nodes or (1,)
    arguments = ("--nodes", ",".join(map(str, ids)), "--model", model, "--port", "0", "--panel-port", "0")
    with _folder() as folder, _telling(CanaxisProcess(folder, "simulate", *arguments)) as process:
        panel = process.until(r"fault panel on (http://\S+)/panel/v1/nodes", STARTING)[1]
        where = process.until(r"simulated module listens on (\S+):(\d+)", STARTING)
        # Only this machine: no proxy that the environment names.
        with httpx.Client(base_url=f"{panel}/panel/v1", timeout=ANSWERING, trust_env=False) as http:
            yield SimulatedPort(where[1], int(where[2]), ids, panel, process, http)


@contextmanager
def serve(
    simulated: SimulatedPort, settings: Mapping[str, object] | None = None
) -> Generator[RunningService]:
    """The service on these modules, in a process that ends with the `with`: the axes are stopped first.

    `settings` are the service's, as in canaxis.yaml. What they leave out: every module is a node (the only
    module with ID 1 is called `stage`, others `node2` and so on), the bus is the simulator's, the heartbeats
    are patient, nothing is remembered. Raises `NotStarted` with what the process said.
    """
    with _folder() as folder:
        (folder / "canaxis.yaml").write_text(json.dumps(_defaults(simulated, folder) | dict(settings or {})))
        with _telling(CanaxisProcess(folder, "serve", "--port", "0")) as process:
            url = process.until(r"Canaxis listens on (http://\S+)/api/v1", STARTING)[1]
            _until_ready(url, process)
            with Client(url) as client:
                yield RunningService(url, client, process)


def _defaults(simulated: SimulatedPort, folder: Path) -> dict[str, object]:
    options = {"host": simulated.host, "port": simulated.port}
    defaults: dict[str, object] = {
        "bus": {"interface": "socketcand", "channel": simulated.channel, "options": options},
        "network": PATIENT,
        "store": {"file": str(folder / "canaxis.db")},
    }
    if simulated.nodes != (1,):
        defaults["nodes"] = [{"id": node, "name": f"node{node}"} for node in simulated.nodes]
    return defaults


def _until_ready(url: str, process: CanaxisProcess) -> None:
    deadline = time.monotonic() + STARTING
    with httpx.Client(base_url=url, timeout=ANSWERING, trust_env=False) as http:
        while not (ready := http.get("/readyz")).is_success:
            if time.monotonic() > deadline:
                raise NotStarted(f"the service is not ready: {ready.text}\n{process.output}")
            time.sleep(LOOKING)


@contextmanager
def _folder() -> Generator[Path]:
    """Where a process runs and keeps what it must: nobody's settings lie there."""
    with tempfile.TemporaryDirectory(prefix="canaxis-") as folder:
        yield Path(folder)


@contextmanager
def _telling(process: CanaxisProcess) -> Generator[CanaxisProcess]:
    """Run it; print what it said, which pytest shows where the test failed."""
    try:
        with process:
            yield process
    finally:
        print(process.output, end="")
