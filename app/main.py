"""The service as an ASGI application; its lifespan opens the network and gives it to every request."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import FastAPI
from fastapi_offline import FastAPIOffline
from starlette.middleware import Middleware

from app import documentation
from app.audit import AuditMiddleware, AuditTrail
from app.errors import install_error_handlers
from app.idempotency import IdempotencyMiddleware
from app.keys import Keys
from app.metrics import LatencyMiddleware
from app.routes import (
    axes,
    bus,
    coordinated,
    events,
    health,
    jog,
    leases,
    moves,
    nodes,
    objects,
    operations,
    positions,
    stop,
    terminals,
    tickets,
    trajectories,
)
from app.routes import settings as settings_routes
from app.routing import attach
from app.security import DOCS_ASSETS, Policy, SecurityMiddleware
from app.service import LifespanState, Service
from app.settings import BusSettings, Settings, SettingsError
from app.tickets import Tickets
from drivers.bus.base import Bus
from drivers.bus.pythoncan import PythonCanBus, interfaces
from drivers.devices.catalog import Catalog
from drivers.errors import BadValue
from drivers.master.network import Network
from drivers.master.plan.axis_parameters import check_ranges
from drivers.master.plan.configuration import NetworkConfig

ROUTERS = (  # in the order in which paths are tried: what is asked most comes first
    axes.router,
    axes.reports,
    axes.commands,
    moves.router,
    coordinated.router,
    nodes.router,
    nodes.commands,
    operations.router,
    terminals.router,
    settings_routes.axis_settings,
    settings_routes.router,
    settings_routes.memory,
    positions.router,
    leases.router,
    stop.router,
    trajectories.router,
    objects.router,
    bus.router,
    events.router,
    jog.router,
    tickets.router,
    health.router,
    health.api_root,
)


def create_app(
    settings: Settings, bus: Bus | None = None, *, on_service: Callable[[Service], None] | None = None
) -> FastAPI:
    """The service for these settings. Raises `SettingsError` if they can't be served.

    `bus` stands in for the one that the settings name; `on_service` is told of the service when the lifespan
    begins.
    """
    settings.check_exposure()
    network_config = settings.network_config()
    catalog = Catalog.load()
    _check_models(network_config, catalog)
    policy = Policy.of(settings.server, settings.trajectories)
    issued = Tickets()
    trail = AuditTrail(settings.audit)
    keys = Keys()
    wire = _wire(settings.bus) if bus is None else bus

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[LifespanState]:
        del app
        service = Service(settings, Network(wire, network_config, catalog), issued, trail, keys)
        if on_service is not None:
            on_service(service)
        await service.open()
        try:
            yield {"service": service}
        finally:
            await service.close()

    app = FastAPIOffline(
        title="Canaxis",
        version=version("canaxis"),
        summary="A CANopen master with an HTTP API for stepper axes in a lab",
        description=documentation.DESCRIPTION,
        docs_url="/docs",
        redoc_url=None,
        static_url=DOCS_ASSETS,
        lifespan=lifespan,
        redirect_slashes=False,
        separate_input_output_schemas=False,
        middleware=[
            Middleware(LatencyMiddleware),
            Middleware(AuditMiddleware, trail=trail),
            Middleware(SecurityMiddleware, policy=policy, tickets=issued),
            Middleware(IdempotencyMiddleware, keys=keys),
        ],
    )
    install_error_handlers(app)
    attach(app, ROUTERS)
    app.openapi = lambda: _openapi_once(app)
    return app


def _wire(settings: BusSettings) -> Bus:
    """The bus that the settings name, not yet open. Raises `SettingsError` for what can never be one."""
    if settings.interface not in (known := interfaces()):
        raise SettingsError(
            f"bus.interface: python-can has no {settings.interface!r}; it has {', '.join(known)}"
        )
    try:
        return PythonCanBus(**settings.arguments())
    except (BadValue, ValueError) as error:
        raise SettingsError(f"bus.options: {error}") from error


def _check_models(config: NetworkConfig, catalog: Catalog) -> None:
    """Refuse a node that the catalog doesn't know, more axes than it has, or what its objects don't take."""
    for node in config.nodes:
        if node.model not in catalog.models:
            raise SettingsError(
                f"nodes: {node.name}: there is no {node.model}; {', '.join(catalog.models)} is"
            )
        if len(node.axes) > (most := catalog.profile(node.model).axes):
            raise SettingsError(f"nodes: {node.name}: a {node.model} has {most} axes, not {len(node.axes)}")
        for number, axis in enumerate(node.axes):
            try:
                check_ranges(axis, catalog.profile(node.model), number)
            except BadValue as error:
                raise SettingsError(f"nodes: {node.name}: {error.message}") from error


def _openapi_once(app: FastAPI) -> dict[str, object]:
    if app.openapi_schema is None:
        app.openapi_schema = documentation.build_openapi(app)
    return app.openapi_schema
