"""Routes are made once, when they are imported."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.routing import Route, WebSocketRoute

from app.configuration.configuration import Configuration
from app.http.parts import part_of
from app.http.paths import API
from app.main import ROUTERS, create_app
from app.service import Parts


def test_every_route_has_its_whole_path_before_the_first_request():
    """One that is included by FastAPI is made anew by the first request, which may be a stop."""
    routes = create_app(Configuration()).router.routes
    paths = [route.path for route in routes if isinstance(route, Route | WebSocketRoute)]
    strangers = [route for route in routes if not isinstance(route, Route) and not hasattr(route, "path")]
    assert not strangers, "make its router an app.routing.Router, and put it into app.main.ROUTERS"
    assert f"{API}/nodes/{{node}}/axes/{{axis}}/stop" in paths
    assert set(paths) >= {str(getattr(route, "path", "")) for router in ROUTERS for route in router.routes}


def test_no_request_waits_for_a_thread():
    """FastAPI calls what is no coroutine in a thread: that costs several times as much, and time."""
    routes = [route for route in create_app(Configuration()).router.routes if isinstance(route, APIRoute)]
    assert len(routes) > 50
    for route in routes:
        for call in _calls(route.dependant):
            assert inspect.iscoroutinefunction(call), (route.path, call)


def test_every_part_that_a_route_asks_for_is_one_that_the_lifespan_hands_out():
    routes = [
        r for r in create_app(Configuration()).router.routes if isinstance(r, APIRoute | APIWebSocketRoute)
    ]
    calls = (call for route in routes for call in _calls(route.dependant))
    asked = {part.name for call in calls if (part := part_of(call)) is not None}
    assert {"network", "leases", "jogs"} <= asked
    assert asked <= set(Parts.__annotations__)


def _calls(dependant: Dependant) -> Iterator[object]:
    yield dependant.call
    for dependency in dependant.dependencies:
        yield from _calls(dependency)
