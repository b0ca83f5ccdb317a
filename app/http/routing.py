"""Routers whose routes have their whole path from the start.

FastAPI makes each route of an included router anew, with the path under which it is included, when the first
request comes. For ours that takes as long as the import of all routes did, and holds up the event loop, and
thereby that request, which may be a stop.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from fastapi import APIRouter, FastAPI

from app.http.documentation import operation_id


class Router(APIRouter):
    """Routes of the service; `prefix` is what their paths begin with, from the root of the server."""

    def __init__(self, prefix: str, **options: Any) -> None:
        super().__init__(prefix=prefix, generate_unique_id_function=operation_id, **options)


def attach(app: FastAPI, routers: Iterable[Router]) -> None:
    """Have the application serve these routes, in this order. Its own defaults don't reach them."""
    for router in routers:
        app.router.routes.extend(router.routes)
