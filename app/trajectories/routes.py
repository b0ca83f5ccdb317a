"""Trajectories: several axes along a path of time-stamped points."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Annotated

from fastapi import Query, Request
from starlette.responses import Response

from app.axes.units import Scale
from app.http.documentation import MOVING, Responses, problems
from app.http.finding import NetworkDep, find_axis
from app.http.parameters import DryRun
from app.http.paths import API
from app.http.problems import ApiError
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.http.uploads import Upload
from app.operations.answers import location_header, operation_links, preference_header
from app.operations.schemas import OperationReply
from app.operations.starting import StarterDep
from app.trajectories.deps import TrajectoriesDep
from app.trajectories.reading import Column, read_points
from app.trajectories.schemas import BODY, AxisForecast, TrajectoryForecast
from drivers.errors import NotReady, UnknownAxis, UnknownNode
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import MotionKind
from drivers.master.network import Network
from drivers.master.plan.configuration import AxisConfig
from drivers.master.together.trajectory import Trajectory, TrajectoryRequest, begin_trajectory, check_period
from drivers.master.together.trajectory_check import Survey, survey
from drivers.master.together.trajectory_file import PointFile
from drivers.obstacles import SETTINGS_CHANGED

CYCLE_MS = 10
"""Where none is given."""
ANSWERS: Responses = {
    200: {
        "description": "It ended while the request waited, `state` says how; or, with `dry_run`, what it "
        "comes to.",
        "model": OperationReply | TrajectoryForecast,
        "headers": preference_header(),
    },
    202: {
        "description": "It is under way; ask at `Location`.",
        "model": OperationReply,
        "headers": {**location_header(), **preference_header()},
        "links": operation_links(),
    },
    **problems(
        *(code for code in MOVING if code != "json_required"),
        *("trajectory_refused", "media_type_unknown", "no_room"),
    ),
}

router = Router(f"{API}/trajectories", tags=["moves"], responses=ANSWERS)


@router.post(
    "",
    summary="Follow a path",
    status_code=202,
    response_model=OperationReply,
    openapi_extra={"requestBody": BODY},
)
async def start_trajectory(
    request: Request,
    network: NetworkDep,
    tasks: TasksDep,
    configuration: TrajectoriesDep,
    starter: StarterDep,
    cycle_ms: Annotated[
        int | None,
        Query(
            ge=1, le=100, description="For a body without it (CSV): milliseconds from set point to set point."
        ),
    ] = None,
    dry_run: DryRun = False,
) -> OperationReply | Response:
    """Have axes of one bus follow time-stamped points (csp), each set point with its SYNC.

    The path is a straight line between two points, or a cubic polynomial where both have velocities. It
    must begin where the axes stand and end at rest. The whole of it is looked at first, against speed,
    acceleration and travel of each axis: refused, it says where it fails first, and nothing is sent. Whatever
    ends it for one axis brings all to rest on the path.
    """
    tasks.check_open()
    upload: Upload = request.state.upload
    reading = await asyncio.to_thread(read_points, upload, configuration.folder)
    points = reading.points
    begun = False

    def begin(operation_id: str) -> Trajectory:
        nonlocal begun
        _require_unchanged(axes, configs)
        trajectory = begin_trajectory(asked, operation_id=operation_id)
        begun = True
        return trajectory

    try:
        period_ms = _agreed(reading.cycle_ms, cycle_ms)
        check_period(period_ms)
        axes = _resolve(network, reading.columns, points)
        configs = [axis.config for axis in axes]
        found = await _surveyed(points, period_ms, axes)
        if dry_run:
            points.close()
            forecast = _forecast(axes, found, period_ms)
            return Response(forecast.model_dump_json(), media_type="application/json")
        asked = TrajectoryRequest(axes, points, period_ms, found)
        told = {
            "axes": [
                {"node": axis.node.node_id, "axis": axis.number, "unit": column.unit}
                for axis, column in zip(axes, reading.columns, strict=True)
            ],
            "cycle_ms": period_ms,
            "points": found.points,
            "duration_s": found.duration_s,
        }
        return await starter.start(MotionKind.TRAJECTORY, axes, told, begin)
    except Exception:
        if not begun:
            points.close()
        raise


async def _surveyed(points: PointFile, period_ms: int, axes: tuple[Axis, ...]) -> Survey:
    try:
        return await asyncio.to_thread(survey, points.points(), period_ms / 1000, axes)
    except OSError as error:  # the last points go to the disk only now
        raise ApiError("no_room", f"The points could not be put aside: {error.strerror or error}.") from error


def _require_unchanged(axes: tuple[Axis, ...], configs: Sequence[AxisConfig]) -> None:
    """Raise `NotReady` if the limits or units with which a long path was looked at don't count any more."""
    for axis, config in zip(axes, configs, strict=True):
        if axis.config != config:
            found = SETTINGS_CHANGED.found(
                f"The settings of axis {axis.name} changed while the path was looked at."
            )
            raise NotReady(found.message, obstacles=(found,), node=axis.node.node_id, axis=axis.number)


def _agreed(in_body: int | None, in_query: int | None) -> int:
    if in_body is not None and in_query is not None and in_body != in_query:
        raise ApiError("bad_request", "cycle_ms is there twice, and not the same.", hint="Give it once.")
    given = in_query if in_body is None else in_body
    return CYCLE_MS if given is None else given


def _resolve(network: Network, columns: list[Column], points: PointFile) -> tuple[Axis, ...]:
    """The axes, and the points in their units."""
    axes = tuple(_axis(network, column) for column in columns)
    points.scales = tuple(
        float(Scale.named(column.unit, axis.config).ratio) for column, axis in zip(columns, axes, strict=True)
    )
    if len(set(axes)) != len(axes):
        raise ApiError("bad_value", "An axis is named twice.", hint="Name each axis once.")
    return axes


def _axis(network: Network, column: Column) -> Axis:
    """The axis of a column. Names may have dots in them: the first way to part them that fits counts."""
    if column.node is not None:
        return find_axis(network, column.node, column.axis)
    parts = column.axis.split(".")
    for at in range(len(parts) - 1, 0, -1):
        try:
            return find_axis(network, ".".join(parts[:at]), ".".join(parts[at:]))
        except (UnknownNode, UnknownAxis):
            continue
    raise UnknownAxis(
        f"There is no axis {column.axis[:80]!r}.", hint="A column is named node.axis[unit], e.g. stage.x[mm]."
    )


def _forecast(axes: tuple[Axis, ...], found: Survey, period_ms: int) -> TrajectoryForecast:
    told: list[AxisForecast] = []
    for axis, peaks, end in zip(axes, found.peaks, found.end, strict=True):
        scale = Scale.of(axis.config)
        told.append(
            AxisForecast(
                node=axis.node.node_id,
                axis=axis.number,
                name=axis.name,
                end=scale.quantity(round(end)),
                lowest=scale.quantity(round(peaks.lowest)),
                highest=scale.quantity(round(peaks.highest)),
                peak_velocity=scale.quantity(round(peaks.speed), "/s"),
                peak_acceleration=scale.quantity(round(peaks.acceleration), "/s2"),
            )
        )
    return TrajectoryForecast(
        points=found.points,
        cycles=found.cycles,
        cycle_ms=period_ms,
        duration_s=found.duration_s,
        axes=told,
    )
