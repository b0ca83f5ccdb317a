"""The move that a request means: to a target, or to a position by its name."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.axes.deps import AxisDep
from app.axes.units import STEPS, Scale
from app.moves.schemas import GoBody, MoveBody, MoveOrGoBody, NamedMove
from app.positions.deps import PositionsDep
from app.positions.positions import check_going


async def wanted_move(body: MoveOrGoBody, axis: AxisDep, positions: PositionsDep) -> MoveBody:
    """The body with its target; a named one is in steps, and says the name too.

    Raises `ApiError` (404, 422, 503) and `NotReady`.
    """
    if not isinstance(body, GoBody):
        return body
    position = await positions.find(axis, body.position)
    check_going(axis, position)
    scale = Scale.of(axis.config) if body.unit is None else Scale.named(body.unit, axis.config)
    return NamedMove(
        position=position.name,
        target=position.steps,
        unit=STEPS,
        velocity=scale.rate("velocity", body.velocity),
        acceleration=scale.rate("acceleration", body.acceleration),
        deceleration=scale.rate("deceleration", body.deceleration),
        on_busy=body.on_busy,
    )


MoveDep = Annotated[MoveBody, Depends(wanted_move)]
