"""`canaxis simulate`: a module for those who have none at hand, on a bus that any program can join."""

from __future__ import annotations

import asyncio
import contextlib
import re
import signal
from collections.abc import AsyncGenerator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Annotated

import typer

from app.commands.parent import ExitWithParent, watching_parent
from app.configuration.sections import ConfigurationError
from app.panel.server import panel_server
from drivers.bus.pythoncan import PythonCanBus
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile
from drivers.sim.module import SimulatedModule
from drivers.sim.runner import SimulatedNode
from drivers.sim.socketcand import HOST, PORT
from drivers.sim.station import Listen, Station
from drivers.sim.storage import FileStore, MemoryStore, Store

LISTENS = "simulated module listens on "
"""What the last line begins with that is printed before the modules can be used."""
PANEL = "fault panel on "
"""What the line before it begins with where there is a panel."""


def simulate(
    host: Annotated[str, typer.Option(help="Address of the socketcand server.")] = HOST,
    port: Annotated[int, typer.Option(help="Its port; 0 takes a free one.")] = PORT,
    interface: Annotated[
        str | None, typer.Option(help="Join this python-can interface instead of being a server.")
    ] = None,
    channel: Annotated[str | None, typer.Option(help="Channel of that interface, e.g. vcan0.")] = None,
    nodes: Annotated[str, typer.Option("--nodes", "--node-id", help="Node IDs, e.g. 1 or 1-8 or 1,5.")] = "1",
    model: Annotated[str, typer.Option(help="Model of the modules.")] = "TMCM-3216",
    store: Annotated[
        Path | None, typer.Option(help="Folder for what the modules save; forgotten at the end if left out.")
    ] = None,
    panel_port: Annotated[
        int | None, typer.Option(help="Serve the fault panel on this port of 127.0.0.1; 0 takes a free one.")
    ] = None,
    exit_with_parent: ExitWithParent = False,
) -> None:
    """Simulate modules on a CAN bus of their own, served by socketcand, or on a real one."""
    ids = parse_nodes(nodes)
    try:
        profile = Catalog.load().profile(model)
    except KeyError as error:
        raise ConfigurationError(f"--model {model}: known are {', '.join(Catalog.load().models)}") from error
    if interface is None:
        place = _on_server(profile, ids, Listen(host, port), store, panel_port)
    elif panel_port is not None:
        raise ConfigurationError(
            "--panel-port: the panel needs the simulator's own bus; leave --interface out"
        )
    else:
        place = _on_interface(profile, ids, interface, channel, store)
    asyncio.run(_run(place, exit_with_parent))


def parse_nodes(text: str) -> list[int]:
    """Node IDs: numbers and ranges, separated by commas. Raises `ConfigurationError`."""
    ids: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,3})(?:-(\d{1,3}))?\s*", part)
        first, last = (0, 0) if match is None else (int(match[1]), int(match[2] or match[1]))
        if not 1 <= first <= last <= 127:
            raise ConfigurationError(f"--nodes {text}: node IDs are 1 to 127, e.g. 1 or 1-8 or 1,5")
        ids |= set(range(first, last + 1))
    return sorted(ids)


@asynccontextmanager
async def _on_server(
    profile: DeviceProfile, ids: list[int], listen: Listen, folder: Path | None, panel_port: int | None
) -> AsyncGenerator[str]:
    """The modules on a wire of this process, and a server through which others join it."""
    station = Station(ids, profile, listen=listen, store=lambda node_id: _store(folder, node_id))
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(station)
        if panel_port is not None:
            url = await stack.enter_async_context(panel_server(station, panel_port))
            print(f"{PANEL}{url}/panel/v1/nodes (documentation: {url}/docs)", flush=True)
        assert station.server is not None
        yield f"{listen.host}:{station.server.port}"


@asynccontextmanager
async def _on_interface(
    profile: DeviceProfile, ids: list[int], interface: str, channel: str | None, folder: Path | None
) -> AsyncGenerator[str]:
    """Each module with a connection of its own to a bus that others provide."""
    async with AsyncExitStack() as stack:
        for node_id in ids:
            module = SimulatedModule(profile, node_id, serial=node_id, store=_store(folder, node_id))
            await stack.enter_async_context(SimulatedNode(module, PythonCanBus(interface, channel)))
        yield interface if channel is None else f"{interface}:{channel}"


def _store(folder: Path | None, node_id: int) -> Store:
    return MemoryStore() if folder is None else FileStore(folder / f"node{node_id}.json")


async def _run(place: contextlib.AbstractAsyncContextManager[str], exit_with_parent: bool) -> None:
    """Run until a signal, or until the parent is gone."""
    loop = asyncio.get_running_loop()
    end = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end.set)
    with watching_parent(end.set) if exit_with_parent else contextlib.nullcontext():
        async with place as where:
            print(f"{LISTENS}{where}", flush=True)
            await end.wait()
