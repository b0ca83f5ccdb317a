"""The command `canaxis`: its subcommands are in `app.commands`, a file each."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterable
from importlib import import_module

import typer

from app.settings import SettingsError
from drivers.errors import CanaxisError

COMMANDS = {
    "serve": "app.commands.serve",
    "simulate": "app.commands.simulate",
    "demo": "app.commands.demo",
    "scan": "app.commands.scan",
    "openapi": "app.commands.document",
    "eds": "app.commands.eds",
    "token": "app.commands.token",
}
"""Where the function, or the `Typer`, of each name is."""


def command_line(names: Iterable[str] = COMMANDS) -> typer.Typer:
    """The command with these subcommands. Only their modules are imported: a service needs no simulator."""
    cli = typer.Typer(
        name="canaxis",
        help="A CANopen master with an HTTP API for stepper axes in a lab.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    cli.callback()(lambda: None)  # else a single subcommand would take the place of the command
    for name in names:
        command = getattr(import_module(COMMANDS[name]), name)
        if isinstance(command, typer.Typer):
            cli.add_typer(command, name=name)
        else:
            cli.command(name)(command)
    return cli


def main() -> None:
    """Run a subcommand; what the user can mend is told in a line or two, without a traceback."""
    # What is imported stays: looking through it for garbage would only make the start longer, and later
    # hold up a running service each time.
    gc.disable()
    cli = command_line([name for name in sys.argv[1:2] if name in COMMANDS] or COMMANDS)
    gc.freeze()
    gc.enable()
    try:
        cli()
    except (SettingsError, CanaxisError) as error:
        print(f"canaxis: {error}", file=sys.stderr)
        hint: str = getattr(error, "hint", "")
        if hint.rstrip(".").lower() not in str(error).lower():
            print(f"         {hint}", file=sys.stderr)
        sys.exit(2)
