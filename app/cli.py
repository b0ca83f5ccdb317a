"""The command `canaxis`: its subcommands are in `app.commands`, a file each."""

from __future__ import annotations

import sys

import typer

from app.commands.demo import demo
from app.commands.document import openapi
from app.commands.eds import eds
from app.commands.scan import scan
from app.commands.serve import serve
from app.commands.simulate import simulate
from app.settings import SettingsError
from drivers.errors import CanaxisError

cli = typer.Typer(
    name="canaxis",
    help="A CANopen master with an HTTP API for stepper axes in a lab.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (serve, simulate, demo, scan, openapi):
    cli.command()(command)
cli.add_typer(eds, name="eds")


def main() -> None:
    """Run a subcommand; what the user can mend is told in a line or two, without a traceback."""
    try:
        cli()
    except (SettingsError, CanaxisError) as error:
        print(f"canaxis: {error}", file=sys.stderr)
        hint: str = getattr(error, "hint", "")
        if hint.rstrip(".").lower() not in str(error).lower():
            print(f"         {hint}", file=sys.stderr)
        sys.exit(2)
