"""`canaxis openapi`: the API's description as a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from app.configuration.configuration import Configuration
from app.http.documentation import render
from app.main import create_app


def openapi(
    output: Annotated[Path | None, typer.Option(help="File to write; standard output if left out.")] = None,
) -> None:
    """Print the OpenAPI document of the HTTP API."""
    text = render(create_app(Configuration()).openapi())
    if output is None:
        sys.stdout.write(text)
    else:
        output.write_text(text, encoding="utf-8")
