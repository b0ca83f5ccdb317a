"""Every error becomes a problem reply: the drivers', our own, the framework's, and what nobody expected."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, cast

import structlog
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import compile_path

from app.http import problems, validation
from app.http.finding import NETWORK
from app.http.paths import operation_path
from app.http.problems import ApiError, ProblemReply
from app.http.replies import problem_response
from app.http.waiting import LONGEST_WAIT
from drivers.errors import AxisBusy, CanaxisError, LineFull, NotReady
from drivers.master.motions.motion import Operation

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.http")

LEAST_PROGRESS = 0.05
"""From where on the rest of a motion can be told from what is done."""


def install_error_handlers(app: FastAPI) -> None:
    """Let no error leave the service in another shape."""
    app.add_exception_handler(CanaxisError, _driver_error)
    app.add_exception_handler(ApiError, _api_error)
    app.add_exception_handler(RequestValidationError, _validation_error)
    app.add_exception_handler(HTTPException, _framework_error)
    app.add_exception_handler(Exception, _unexpected_error)


def _reply(request: Request, reply: ProblemReply, headers: dict[str, str] | None = None) -> Response:
    return problem_response(reply, instance=request.url.path, headers=headers)


async def _driver_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, CanaxisError)
    reply = problems.of_driver_error(error)
    if isinstance(error, NotReady):
        running = _running_motion(request, error)
        if running is not None:
            reply.body["operation"] = operation_path(running.id)
        if running is not None and isinstance(error, AxisBusy):
            reply = reply._replace(retry_after=_rest(running))
    if isinstance(error, LineFull):
        reply = reply._replace(retry_after=min(error.frees_in_s, LONGEST_WAIT))
    return _reply(request, reply)


def _running_motion(request: Request, error: NotReady) -> Operation | None:
    """What holds the axis."""
    if error.node is None or error.axis is None:
        return None
    if (network := NETWORK.of_any(request.scope)) is None:
        return None
    motion = network.node(error.node).axis(error.axis).motion
    return None if motion is None or motion.done else motion


def _rest(motion: Operation) -> float | None:
    """Seconds until a motion ends if it goes on as until now, or as predicted; None if that can't be told."""
    if motion.started is None:
        return None
    passed = (datetime.now(UTC) - motion.started).total_seconds()
    if motion.progress is not None and motion.progress >= LEAST_PROGRESS:
        return passed / motion.progress * (1 - motion.progress)
    left = 0.0 if motion.prediction is None else motion.prediction.duration_s - passed
    return min(left, LONGEST_WAIT) if left > 0 else None


async def _api_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, ApiError)
    return _reply(request, problems.of_api_error(error))


async def _validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    items = cast("list[validation.Item]", list(error.errors()))
    return _reply(request, validation.of_validation(items, _fields_of_body(request)))


def _fields_of_body(request: Request) -> list[str]:
    """The names of the fields that a request to this route may have in its body."""
    route: object = request.scope.get("route")
    body = route.body_field if isinstance(route, APIRoute) else None
    annotation: Any = None if body is None else body.field_info.annotation
    models = (annotation, *getattr(annotation, "__args__", ()))  # a body that may be left out is a union
    return [
        name
        for model in models
        if isinstance(model, type) and issubclass(model, BaseModel)
        for name in model.model_fields
    ]


async def _framework_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 400:  # what FastAPI says of a body that it can't decode
        return _reply(request, validation.of_unreadable())
    headers = dict(error.headers or {})
    if error.status_code == 405:  # the framework names the methods of the first route at this path only
        headers["Allow"] = ", ".join(_methods_at(request)) or headers.get("Allow", "GET")
    detail = {
        404: f"There is nothing at {request.url.path[:200]}.",
        405: f"{request.url.path[:200]} doesn't take {request.method}.",
    }.get(error.status_code, str(error.detail))
    return _reply(request, problems.of_status(error.status_code, detail), headers)


def _methods_at(request: Request) -> list[str]:
    """The methods that the API's document has at the path that was asked for."""
    paths: dict[str, dict[str, object]] = request.app.openapi()["paths"]
    return sorted(
        method.upper()
        for template, operations in paths.items()
        if compile_path(template)[0].match(request.url.path)
        for method in operations
    )


async def _unexpected_error(request: Request, error: Exception) -> Response:
    log.error("unexpected error", path=request.url.path, error=repr(error))
    return _reply(request, problems.problem("internal_error", "Something went wrong that nobody expected."))
