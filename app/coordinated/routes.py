"""Several axes moved together: one operation, one start, one stop."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from fastapi import Response

from app.axes.units import Scale
from app.coordinated import views
from app.coordinated.schemas import MovesBody, MovesPrediction
from app.http.documentation import MOVING, problems
from app.http.finding import NetworkDep, find_axis
from app.http.parameters import DryRun
from app.http.paths import API
from app.http.routing import Router
from app.moves.deps import MeantDep
from app.operations.answers import ANSWERED
from app.operations.schemas import OperationReply
from app.operations.starting import StarterDep
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import MotionKind
from drivers.master.plan.requests import MoveRequest, OnBusy
from drivers.master.together.coordinated_move import CoordinatedMove
from drivers.master.together.coordinated_prediction import CoordinatedPrediction

router = Router(API, tags=["moves"])

_ANSWERS: dict[int | str, dict[str, Any]] = {
    **ANSWERED,
    200: {
        **ANSWERED[200],
        "description": "It ended while the request waited; or, with `dry_run`, what it would be.",
        "model": OperationReply | MovesPrediction,
    },
    **problems(*MOVING),
}


@router.post("/moves", summary="Move axes together", status_code=202, responses=_ANSWERS)
async def move_together(
    body: MovesBody,
    network: NetworkDep,
    meant: MeantDep,
    starter: StarterDep,
    response: Response,
    dry_run: DryRun = False,
) -> OperationReply | MovesPrediction:
    """Start axes of one bus on one SYNC and have them arrive together; the slowest decides.

    All or nothing: what prevents one axis prevents all, and whatever stops one later stops all.
    """
    moves: list[tuple[Axis, MoveRequest]] = []
    aims: list[tuple[Axis, Fraction | None]] = []
    asked: list[dict[str, Any]] = []
    for each in body.targets:
        axis = find_axis(network, each.node, each.axis)
        scale = Scale.named(each.unit, axis.config)
        wanted = scale.exact("target", each.target)
        target, aim = meant.target(axis, wanted, OnBusy(body.on_busy), relative=each.relative)
        request = MoveRequest(
            target=target,
            relative=each.relative,
            velocity=scale.rate("velocity", each.velocity),
            acceleration=scale.rate("acceleration", each.acceleration),
            deceleration=scale.rate("deceleration", each.deceleration),
        )
        moves.append((axis, request))
        aims.append((axis, aim))
        asked.append(
            each.model_dump(exclude_none=True) | scale.commanded("target", each.target, request.target)
        )
    at_least, replace = body.duration_s or 0.0, body.on_busy == "replace"
    if dry_run:
        response.status_code = 200
        return views.prediction(CoordinatedPrediction.of(moves, at_least=at_least, replace=replace))

    def begin(operation_id: str) -> CoordinatedMove:
        group = network.move_together(moves, at_least=at_least, replace=replace, operation_id=operation_id)
        for axis, aim in aims:
            meant.sent(axis, aim)
        return group

    said = body.model_dump(exclude_none=True) | {"targets": asked}
    return await starter.start(MotionKind.COORDINATED_MOVE, [axis for axis, _ in moves], said, begin)
