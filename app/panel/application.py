"""The panel as an ASGI application: one POST for each row of the table of commands, and what they did."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine
from importlib.metadata import version
from typing import Annotated, Any, cast

from fastapi import APIRouter, FastAPI, Path, Request
from fastapi_offline import FastAPIOffline
from starlette.middleware import Middleware

from app.access.policy import Policy
from app.access.security import DOCS_ASSETS, SecurityMiddleware
from app.access.tickets import Tickets
from app.configuration.configuration import ServerConfiguration
from app.http.documentation import operation_id
from app.http.errors import install_error_handlers
from app.http.problem_types import ProblemTypeReply, problem_type
from app.http.problems import MEDIA_TYPE, ApiError
from app.panel.schemas import ModuleList, ModuleReply
from drivers.sim.commands import Command
from drivers.sim.panel import COMMANDS, ModulePanel
from drivers.sim.station import Station

API = "/panel/v1"
DESCRIPTION = """\
The hands on simulated modules: press a switch, cut the supply, lose frames. Every command takes effect at
once and stays until it is undone, or until `clear`. It answers with the state of the module.

This is a tool for trying things out. No service on a real bus has it.
"""

NodeId = Annotated[int, Path(ge=1, le=127, description="Node ID that the module was made with.")]
_PROBLEM: dict[str, Any] = {"content": {MEDIA_TYPE: {}}}
_PROBLEMS: dict[int | str, dict[str, Any]] = {
    404: {"description": "No such module.", **_PROBLEM},
    409: {"description": "The module can't do this now.", **_PROBLEM},
    422: {"description": "The arguments are wrong; the detail says what is allowed.", **_PROBLEM},
}

Endpoint = Callable[[int, Request], Coroutine[Any, Any, ModuleReply]]


def create_panel(station: Station, port: int) -> FastAPI:
    """The panel of a station whose loop it runs in, served on `port` of this machine only."""
    policy = Policy.of(ServerConfiguration(port=port))
    app = FastAPIOffline(
        title="Canaxis fault panel",
        version=version("canaxis"),
        summary="What can be done to simulated modules",
        description=DESCRIPTION,
        docs_url="/docs",
        redoc_url=None,
        static_url=DOCS_ASSETS,
        redirect_slashes=False,
        generate_unique_id_function=operation_id,
        middleware=[Middleware(SecurityMiddleware, policy=policy, tickets=Tickets())],
    )
    install_error_handlers(app)
    app.include_router(_routes(station), prefix=API)
    app.get("/problems/{name}", include_in_schema=False)(_problem_type)
    return app


def _routes(station: Station) -> APIRouter:
    router = APIRouter()

    @router.get("/nodes", summary="All simulated modules")
    async def list_modules() -> ModuleList:
        """What there is to see of each module now."""
        return ModuleList(nodes=[_seen(panel) for panel in station.panels.values()])

    @router.get("/nodes/{node}", summary="One simulated module", responses={404: _PROBLEMS[404]})
    async def get_module(node: NodeId) -> ModuleReply:
        """What there is to see of it now: where its carriages truly are, what is switched on."""
        return _seen(station.panel(node))

    @router.post("/nodes/{node}/clear", summary="Undo everything", responses={404: _PROBLEMS[404]})
    async def clear(node: NodeId) -> ModuleReply:
        """Hands off, supply and connection back. What the module itself holds, a fault say, stays."""
        panel = station.panel(node)
        panel.clear()
        return _seen(panel)

    for command in COMMANDS.values():
        router.add_api_route(
            f"/nodes/{{node}}/{command.name}",
            _endpoint(station, command),
            methods=["POST"],
            name=command.name,
            summary=command.summary.removesuffix("."),
            responses=_PROBLEMS,
            openapi_extra=_body(command),
        )

    @router.post("/nodes/{node}/{command}", include_in_schema=False)
    async def unknown(node: NodeId, command: str) -> None:
        station.panel(node)
        raise ApiError(
            "unknown_path",
            f"There is no command {command[:60]!r}.",
            hint="Known are clear, " + ", ".join(COMMANDS) + ".",
        )

    # Referred to, for the type checker: the router calls them.
    del list_modules, get_module, clear, unknown
    return router


def _endpoint(station: Station, command: Command) -> Endpoint:
    async def perform(node: NodeId, request: Request) -> ModuleReply:
        panel = station.panel(node)
        panel.perform(command.name, _arguments(await request.body()))
        return _seen(panel)

    return perform


async def _problem_type(name: Annotated[str, Path(max_length=64)]) -> ProblemTypeReply:
    return problem_type(name)


def _seen(panel: ModulePanel) -> ModuleReply:
    return ModuleReply(panel.state())


def _arguments(body: bytes) -> dict[str, object]:
    try:
        parsed: object = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        raise ApiError("bad_request", "The body is no JSON text in UTF-8.") from None
    if not isinstance(parsed, dict):
        raise ApiError("bad_request", "The body must be an object of arguments by name.")
    return cast("dict[str, object]", parsed)


def _body(command: Command) -> dict[str, Any]:
    needed = any(parameter.required for parameter in command.parameters)
    return {
        "requestBody": {"required": needed, "content": {"application/json": {"schema": command.schema()}}}
    }
