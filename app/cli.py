"""The command `canaxis`: its subcommands are in `app.commands`, a file each. `canaxis_command` starts it."""

from __future__ import annotations

import gc
import sys
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from typing import Annotated

import typer

from app.configuration.sections import ConfigurationError
from drivers.errors import CanaxisError

COMMANDS = {
    "serve": "app.commands.serve",
    "simulate": "app.commands.simulate",
    "demo": "app.commands.demo",
    "scan": "app.commands.scan",
    "openapi": "app.commands.document",
    "eds": "app.commands.eds",
    "token": "app.commands.token",
    "settings": "app.commands.settings",
}
"""Where the function, or the `Typer`, of each name is."""
SERVING = frozenset({"serve", "demo"})
UNASKED = ("rich", "pydantic.v1")
"""What libraries of the service import if it is there, for what the service does without: structlog for
colourful tracebacks, FastAPI to refuse models of old. Together they would take a tenth of its start.
"""


def command_line(names: Iterable[str] = COMMANDS) -> typer.Typer:
    """The command with these subcommands. Only their modules are imported: a service needs no simulator."""
    cli = typer.Typer(
        name="canaxis",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    cli.callback()(canaxis)  # without one, a single subcommand would take the place of the command
    for name in names:
        command = getattr(import_module(COMMANDS[name]), name)
        if isinstance(command, typer.Typer):
            cli.add_typer(command, name=name)
        else:
            cli.command(name)(command)
    return cli


def _say_version(asked: bool) -> None:
    if asked:
        print(f"canaxis {version('canaxis')}")
        raise typer.Exit


def canaxis(
    version: Annotated[
        bool,
        typer.Option("--version", help="Say which version this is.", callback=_say_version, is_eager=True),
    ] = False,
) -> None:
    """A CANopen master with an HTTP API for stepper axes in a lab."""


@contextmanager
def without(modules: Iterable[str]) -> Generator[None]:
    """Have these modules count as not installed meanwhile, unless they are imported already."""
    hidden = [name for name in modules if name not in sys.modules]
    sys.modules |= dict.fromkeys(hidden)
    try:
        yield
    finally:
        for name in hidden:
            sys.modules.pop(name, None)


def main() -> None:
    """Run a subcommand; what the user can mend is told in a line or two, without a traceback."""
    # What is imported stays: looking through it for garbage would only make the start longer, and later
    # hold up a running service each time.
    gc.disable()
    names = [name for name in sys.argv[1:2] if name in COMMANDS] or list(COMMANDS)
    with without(UNASKED if SERVING.issuperset(names) else ()):
        cli = command_line(names)
    gc.freeze()
    gc.enable()
    try:
        cli()
    except (ConfigurationError, CanaxisError) as error:
        print(f"canaxis: {error}", file=sys.stderr)
        hint: str = getattr(error, "hint", "")
        if hint.rstrip(".").lower() not in str(error).lower():
            print(f"         {hint}", file=sys.stderr)
        sys.exit(2)
