"""What a jog's connection needs of the package `websockets`, which nothing else of the client does.

It is imported when the first connection is opened; its errors become the client's here.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Generator, Mapping
from typing import Any

from canaxis.errors import CanaxisError, Forbidden, ServiceUnreachable


class Closed(Exception):
    """The connection is not open: not yet, or not any more."""


def library(name: str) -> Any:
    """A module of `websockets`. Raises `CanaxisError` where that isn't installed."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise CanaxisError(
            "Jogging needs the package websockets, which is not installed.", hint="pip install 'canaxis[jog]'"
        ) from error


def options(headers: Mapping[str, str], within: float) -> dict[str, Any]:
    """How a connection is opened: without compression, and past every proxy that the environment names."""
    return {
        "additional_headers": dict(headers),
        "compression": None,
        "proxy": None,
        "open_timeout": within,
    }


@contextlib.contextmanager
def opening(url: str) -> Generator[None]:
    """While a connection is opened: what goes wrong is raised as a `CanaxisError`."""
    exceptions = library("websockets.exceptions")
    try:
        yield
    except exceptions.InvalidStatus as error:
        raise Forbidden(
            f"The service refuses the connection: {error}.",
            hint="Jogging needs a token with the role move.",
            status=error.response.status_code,
        ) from error
    except (OSError, exceptions.InvalidHandshake, exceptions.InvalidURI) as error:
        raise ServiceUnreachable(f"No connection to {url}: {error}") from error


@contextlib.contextmanager
def in_use() -> Generator[None]:
    """While a connection is used: raises `Closed` once it is gone, and leaves a TimeoutError alone."""
    try:
        yield
    except TimeoutError:
        raise
    except (OSError, library("websockets.exceptions").ConnectionClosed) as error:
        raise Closed(str(error)) from error
