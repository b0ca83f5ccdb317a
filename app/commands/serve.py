"""`canaxis serve`: the service on a bus that is there."""

from __future__ import annotations

import asyncio
import re
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from app.commands.logs import configure_logs
from app.commands.parent import ExitWithParent, watching_parent
from app.configuration.configuration import default_store
from app.configuration.loading import load_configuration
from app.configuration.sections import ConfigurationError
from app.server import run_server
from app.service import Service

_NODE = re.compile(r"(\d{1,3})(?::([A-Za-z][A-Za-z0-9_.-]*))?(?::([A-Za-z0-9_.-]+))?")


def serve(
    config: Annotated[Path | None, typer.Option(help="Settings, YAML or TOML.")] = None,
    interface: Annotated[str | None, typer.Option(help="python-can's interface, e.g. socketcan.")] = None,
    channel: Annotated[str | None, typer.Option(help="python-can's channel, e.g. can0.")] = None,
    bitrate: Annotated[int | None, typer.Option(help="bit/s, e.g. 1000000.")] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="Another option of the interface, NAME=VALUE; may be repeated.")
    ] = None,
    node: Annotated[
        list[str] | None, typer.Option(help="A module: ID[:NAME[:MODEL]]; may be repeated.")
    ] = None,
    host: Annotated[
        str | None, typer.Option(help="Address to listen on; others than 127.0.0.1 need a token.")
    ] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on.")] = None,
    token_file: Annotated[Path | None, typer.Option(help="File with the bearer token, mode 0600.")] = None,
    store: Annotated[
        Path | None, typer.Option(help="SQLite file for operations; else the user's folder for state.")
    ] = None,
    log_format: Annotated[str | None, typer.Option(help="console or json.")] = None,
    exit_with_parent: ExitWithParent = False,
) -> None:
    """Serve the HTTP API for the modules on a CAN bus."""
    bus = {"interface": interface, "channel": channel, "bitrate": bitrate}
    overrides = {
        "bus": _given(bus) | ({"options": dict(map(parse_option, option))} if option else {}),
        "server": _given({"host": host, "port": port, "token_file": token_file}),
        "store": _given({"file": store}),
        "log": _given({"format": log_format}),
    }
    if node:
        overrides["nodes"] = [parse_node(text) for text in node]  # pyright: ignore[reportArgumentType]
    configuration = load_configuration(config, overrides).with_store(default_store())
    configure_logs(configuration.log)
    if not run_server(configuration, _announce_to_parent if exit_with_parent else _announce):
        sys.exit(1)


async def _announce(service: Service, url: str) -> None:
    del service
    print(f"Canaxis listens on {url}/api/v1 (documentation: {url}/docs)", flush=True)


async def _announce_to_parent(service: Service, url: str) -> None:
    """As `_announce`; the parent's end is to us what SIGTERM is. The server cancels this when it ends."""
    with watching_parent(lambda: signal.raise_signal(signal.SIGTERM)):
        await _announce(service, url)
        await asyncio.Future()


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def parse_option(text: str) -> tuple[str, int | str]:
    """NAME=VALUE; whole numbers become numbers. Raises `ConfigurationError`."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise ConfigurationError(f"--option {text}: NAME=VALUE is expected")
    return name, int(value) if value.isascii() and value.isdecimal() else value


def parse_node(text: str) -> dict[str, Any]:
    """ID[:NAME[:MODEL]]. Raises `ConfigurationError`."""
    match = _NODE.fullmatch(text)
    if match is None:
        raise ConfigurationError(f"--node {text}: ID, ID:NAME or ID:NAME:MODEL is expected, e.g. 1:stage")
    return {"id": int(match[1]), "name": match[2] or f"node{match[1]}"} | _given({"model": match[3]})
