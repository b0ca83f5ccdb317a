"""The service as an ASGI application; its lifespan opens the network and gives it to every request."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import FastAPI
from fastapi_offline import FastAPIOffline
from starlette.middleware import Middleware

from app.access import routes as access_routes
from app.access.audit import AuditMiddleware, AuditTrail
from app.access.documentation import describe_access
from app.access.policy import Policy
from app.access.security import DOCS_ASSETS, SecurityMiddleware
from app.access.tickets import Tickets
from app.axes import routes as axes_routes
from app.bus import routes as bus_routes
from app.configuration.configuration import BusConfiguration, Configuration
from app.configuration.sections import ConfigurationError
from app.coordinated import routes as coordinated_routes
from app.events import routes as events_routes
from app.health import routes as health_routes
from app.health.metrics import LatencyMiddleware
from app.http import documentation
from app.http.errors import install_error_handlers
from app.http.routing import attach
from app.idempotency.keys import Keys
from app.idempotency.middleware import IdempotencyMiddleware
from app.io import routes as io_routes
from app.jog import routes as jog_routes
from app.leases import routes as leases_routes
from app.moves import routes as moves_routes
from app.nodes import routes as nodes_routes
from app.objects import routes as objects_routes
from app.operations import routes as operations_routes
from app.positions import routes as positions_routes
from app.service import Parts, Service
from app.settings import routes as settings_routes
from app.stop import routes as stop_routes
from app.trajectories import routes as trajectories_routes
from drivers.bus.base import Bus
from drivers.bus.pythoncan import PythonCanBus, interfaces
from drivers.devices.catalog import Catalog
from drivers.errors import BadValue
from drivers.master.network import Network
from drivers.master.plan.axis_parameters import check_ranges
from drivers.master.plan.configuration import NetworkConfig

ROUTERS = (  # in the order in which paths are tried: what is asked most comes first
    axes_routes.router,
    axes_routes.reports,
    axes_routes.commands,
    moves_routes.router,
    coordinated_routes.router,
    nodes_routes.router,
    nodes_routes.commands,
    operations_routes.router,
    io_routes.router,
    settings_routes.axis_settings,
    settings_routes.router,
    settings_routes.memory,
    positions_routes.router,
    leases_routes.router,
    stop_routes.router,
    trajectories_routes.router,
    objects_routes.router,
    bus_routes.router,
    events_routes.router,
    jog_routes.router,
    access_routes.router,
    health_routes.router,
    health_routes.api_root,
)


def create_app(
    configuration: Configuration,
    bus: Bus | None = None,
    *,
    on_service: Callable[[Service], None] | None = None,
) -> FastAPI:
    """The service for this configuration. Raises `ConfigurationError` if it can't be served.

    `bus` stands in for the one that it names; `on_service` is told of the service when the lifespan begins.
    """
    configuration.check_exposure()
    network_config = configuration.network_config()
    catalog = Catalog.load()
    _check_models(network_config, catalog)
    policy = Policy.of(configuration.server, configuration.trajectories)
    issued = Tickets()
    trail = AuditTrail(configuration.audit)
    keys = Keys()
    wire = _wire(configuration.bus) if bus is None else bus

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[Parts]:
        del app
        service = Service(configuration, Network(wire, network_config, catalog), issued, trail, keys)
        if on_service is not None:
            on_service(service)
        try:
            await service.open()
            yield service.parts
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


def _wire(configuration: BusConfiguration) -> Bus:
    """The bus that is configured, not yet open. Raises `ConfigurationError` for what can never be one."""
    if configuration.interface not in (known := interfaces()):
        raise ConfigurationError(
            f"bus.interface: python-can has no {configuration.interface!r}; it has {', '.join(known)}"
        )
    try:
        return PythonCanBus(**configuration.arguments())
    except (BadValue, ValueError) as error:
        raise ConfigurationError(f"bus.options: {error}") from error


def _check_models(config: NetworkConfig, catalog: Catalog) -> None:
    """Refuse a node that the catalog doesn't know, more axes than it has, or what its objects don't take."""
    for node in config.nodes:
        if node.model not in catalog.models:
            raise ConfigurationError(
                f"nodes: {node.name}: there is no {node.model}; {', '.join(catalog.models)} is"
            )
        if len(node.axes) > (most := catalog.profile(node.model).axes):
            raise ConfigurationError(
                f"nodes: {node.name}: a {node.model} has {most} axes, not {len(node.axes)}"
            )
        for number, axis in enumerate(node.axes):
            try:
                check_ranges(axis, catalog.profile(node.model), number)
            except BadValue as error:
                raise ConfigurationError(f"nodes: {node.name}: {error.message}") from error


def _openapi_once(app: FastAPI) -> dict[str, object]:
    if app.openapi_schema is None:
        app.openapi_schema = documentation.build_openapi(app, describe_access)
    return app.openapi_schema
