"""`canaxis demo`: a simulated module in a process of its own, and the service on it."""

from __future__ import annotations

import asyncio
import select
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from app.commands.logs import configure_logs
from app.commands.simulate import LISTENS, PANEL
from app.configuration.loading import load_configuration
from app.configuration.sections import ConfigurationError
from app.server import run_server
from app.service import Service
from drivers import program
from drivers.master.seen.status import NodeState

STARTING = 20.0
"""Seconds that the simulator gets to start."""
ENDING = 3.0
"""Seconds that it gets to end."""
CONFIGURING = 10.0
"""Seconds after which the demo tells how to use it even if the module isn't configured yet."""


def demo(
    port: Annotated[int | None, typer.Option(help="Port of the HTTP API.")] = None,
    can_port: Annotated[int, typer.Option(help="Port of the simulator's socketcand server.")] = 29536,
    panel_port: Annotated[
        int, typer.Option(help="Port of the simulator's fault panel; 0 takes a free one.")
    ] = 0,
    config: Annotated[
        Path | None, typer.Option(help="Settings of the service; the bus in it is not used.")
    ] = None,
) -> None:
    """Start a simulated three-axis module and the service; Ctrl-C stops the axes, then both."""
    overrides: dict[str, Any] = {"log": {"level": "warning"}}
    if port is not None:
        overrides["server"] = {"port": port}
    configuration = load_configuration(config, overrides)
    configure_logs(configuration.log)
    with _simulator(can_port, panel_port, [node.id for node in configuration.nodes]) as simulator:
        bus = {
            "interface": "socketcand",
            "channel": "can0",
            "bitrate": None,
            "options": {"host": "127.0.0.1", "port": simulator.port},
        }
        configuration = load_configuration(config, overrides | {"bus": bus})
        ended_well = run_server(configuration, partial(_announce, simulator.panel))
    if not ended_well:
        sys.exit(1)
    print("Axes stopped and disabled; service and simulator ended.", flush=True)


class Simulator(NamedTuple):
    """Where the simulator listens."""

    port: int
    """Of its socketcand server."""
    panel: str
    """Where its fault panel is."""


@contextmanager
def _simulator(port: int, panel_port: int, nodes: list[int]) -> Generator[Simulator]:
    """A simulator in a session of its own: Ctrl-C comes to us, and the axes stop before it ends.

    It ends with us whatever happens: it watches its standard input, which closes with our last breath.
    """
    process = subprocess.Popen(
        program.command(
            *("app", "simulate", "--exit-with-parent"),
            *("--port", str(port), "--panel-port", str(panel_port)),
            *("--nodes", ",".join(map(str, nodes))),
        ),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        bufsize=0,  # or a line might wait in our buffer, where `select` doesn't see it
        start_new_session=True,
    )
    try:
        yield _wait_until_it_listens(process)
    finally:
        _end(process)


def _wait_until_it_listens(process: subprocess.Popen[bytes]) -> Simulator:
    assert process.stdout is not None
    deadline = time.monotonic() + STARTING
    panel = ""
    while time.monotonic() < deadline:
        if select.select([process.stdout], [], [], 0.1)[0]:
            line = process.stdout.readline().decode().rstrip()
            if not line:
                raise ConfigurationError("the simulator did not start (see above); try --can-port 0")
            if line.startswith(PANEL):
                panel = line.removeprefix(PANEL)
            elif line.startswith(LISTENS):
                return Simulator(int(line.rpartition(":")[2]), panel)
    raise ConfigurationError(f"the simulator did not start within {STARTING:g} s")


def _end(process: subprocess.Popen[bytes]) -> None:
    """Close its input, which asks it to end; insist where that is not enough."""
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    for insist in (process.terminate, process.kill):
        try:
            process.wait(ENDING)
        except subprocess.TimeoutExpired:
            insist()
    process.wait()


async def _announce(panel: str, service: Service, url: str) -> None:
    """Say where everything is, once the module is configured."""
    await _until_operational(service)
    axis = f"{url}/api/v1/nodes/{next(iter(service.network.nodes))}/axes/0"
    json_type = "-H 'Content-Type: application/json'"
    print(
        f"""
Canaxis runs with a simulated module. This is a demonstration: no motor moves.

  API            {url}/api/v1
  documentation  {url}/docs
  event stream   {url}/api/v1/events
  fault panel    {panel}

Enable the first axis, move it one turn, look at it, stop everything, allow motion again:

  curl -X POST {json_type} {axis}/enable
  curl {json_type} -d '{{"target": 51200, "unit": "steps", "relative": true}}' '{axis}/move?wait=20'
  curl {axis}
  curl -X POST {url}/api/v1/stop
  curl -X POST {json_type} {url}/api/v1/stop/reset

Ctrl-C ends both.
""",
        flush=True,
    )


async def _until_operational(service: Service) -> None:
    """Wait for every node, but not for ever: the readiness check tells what is missing."""
    events = service.network.events.subscribe()
    try:
        async with asyncio.timeout(CONFIGURING):
            while not all(n.status().state is NodeState.OPERATIONAL for n in service.network.nodes.values()):
                if await events.get() is None:
                    return
    except TimeoutError:
        print("The module is not ready yet; see /readyz.", flush=True)
    finally:
        events.close()
