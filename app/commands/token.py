"""`canaxis token`: make a token."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from app.access.roles import ROLES
from app.access.tokens import add_token
from app.configuration.loading import load_configuration
from app.configuration.sections import ConfigurationError


def token(
    name: Annotated[str, typer.Argument(help="Whom it is for; the record of commands shows it.")],
    role: Annotated[str, typer.Option(help=f"What it entitles to: {', '.join(ROLES)}.")] = "move",
    token_file: Annotated[
        Path | None, typer.Option(help="File to add it to; else the settings' server.token_file.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="Settings, YAML or TOML.")] = None,
) -> None:
    """Make a token and show it once; its hash goes into the token file."""
    if role not in ROLES:
        raise ConfigurationError(f"--role {role}: one of {', '.join(ROLES)} is expected")
    path = token_file or load_configuration(config).server.token_file
    if path is None:
        raise ConfigurationError("--token-file: the settings name no server.token_file to keep the token in")
    secret = add_token(path, name, ROLES[role])
    print(secret)
    print(
        f"This is the token of {name} ({role}), shown this once. Its hash is in {path}, "
        "which the service reads when it starts.",
        file=sys.stderr,
    )
