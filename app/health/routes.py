"""The service itself: at the root, outside the API's version."""

from __future__ import annotations

from importlib.metadata import version
from typing import Annotated

from fastapi import Path, Response
from fastapi.responses import PlainTextResponse

from app.health.deps import ConditionDep, MetricsDep
from app.health.schemas import LiveReply, ReadyReply, ServiceReply
from app.http.documentation import problems
from app.http.paths import API
from app.http.problem_types import ProblemTypeReply, problem_type
from app.http.routing import Router

router = Router("", tags=["service"])
api_root = Router(API, tags=["service"])

NOT_READY = {503: {"description": "Something that is configured can't be commanded.", "model": ReadyReply}}
METRICS_TYPE = "text/plain; version=0.0.4; charset=utf-8"


@router.get("/livez", summary="Whether the process answers", responses=problems())
async def get_livez() -> LiveReply:
    """Answers as long as the event loop runs."""
    return LiveReply(status="alive")


@router.get("/readyz", summary="Whether everything can be commanded", responses={**problems(), **NOT_READY})
async def get_readyz(condition: ConditionDep, response: Response) -> ReadyReply:
    """503 with reasons while the bus is down or a configured node is not operational."""
    reasons = condition.reasons()
    response.status_code = 503 if reasons else 200
    return ReadyReply(ready=not reasons, reasons=reasons, warnings=condition.warnings())


@router.get(
    "/metrics",
    summary="Measurements for Prometheus",
    response_class=PlainTextResponse,
    responses={200: {"content": {"text/plain": {"example": "canaxis_bus_up 1.0\n"}}}, **problems()},
)
async def get_metrics(metrics: MetricsDep) -> Response:
    """Counters of the bus, the nodes, the operations and this API."""
    return Response(metrics.render(), media_type=METRICS_TYPE)


@router.get("/problems/{name}", summary="What a problem means", responses=problems("unknown_problem"))
async def get_problem_type(
    name: Annotated[str, Path(max_length=64, examples=["not-ready"])],
) -> ProblemTypeReply:
    """The description behind a problem's `type`."""
    return problem_type(name)


@api_root.get("", summary="Where everything is", responses=problems())
async def get_service() -> ServiceReply:
    """The service's version and its main resources."""
    return ServiceReply(
        name="canaxis",
        version=version("canaxis"),
        links={
            "nodes": "/api/v1/nodes",
            "operations": "/api/v1/operations",
            "events": "/api/v1/events",
            "bus": "/api/v1/bus",
            "stop": "/api/v1/stop",
            "documentation": "/docs",
            "openapi": "/openapi.json",
        },
    )
