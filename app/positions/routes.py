"""Named positions of an axis."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from fastapi import Depends, Path

from app.axes.deps import AxisDep
from app.axes.units import Scale
from app.http.documentation import AXIS, KEYS, LEASES, UNSAFE, problems
from app.http.paths import API
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.idempotency.deps import AskerDep, command_headers
from app.positions import views
from app.positions.deps import PositionsDep
from app.positions.positions import present
from app.positions.schemas import NAME, NamedPositionList, NamedPositionReply, TeachBody
from app.positions.table import NamedPosition

router = Router(f"{API}/nodes/{{node}}/axes/{{axis}}/positions", tags=["positions"])

NameRef = Annotated[
    str, Path(description="Name of the position.", pattern=NAME, max_length=64, examples=["park"])
]
CHANGE = (*AXIS, *UNSAFE, *KEYS, *LEASES, "store_off")


@router.get("", summary="Named positions", responses=problems(*AXIS, "store_off"))
async def list_positions(axis: AxisDep, positions: PositionsDep) -> NamedPositionList:
    """Every position of the axis that was given a name."""
    found = await positions.all_of(axis)
    return NamedPositionList(positions=[views.named_position(axis, position) for position in found])


@router.get(
    "/{name}", summary="One named position", responses=problems(*AXIS, "unknown_position", "store_off")
)
async def get_position(axis: AxisDep, name: NameRef, positions: PositionsDep) -> NamedPositionReply:
    """Where it is."""
    return views.named_position(axis, await positions.find(axis, name))


@router.put(
    "/{name}",
    summary="Teach a position",
    dependencies=[Depends(command_headers)],
    responses=problems(*CHANGE, "not_ready", "bad_value", "node_away"),
)
async def teach_position(
    body: TeachBody, axis: AxisDep, name: NameRef, positions: PositionsDep, tasks: TasksDep, asker: AskerDep
) -> NamedPositionReply:
    """Give a position a name, or a name another position: where the axis stands, or one that is told.

    Answers once it is durable. Refused outside of the travel limits; where the axis stands is taken only from
    an axis that stands and was homed.
    """
    scale = Scale.of(axis.config) if body.unit is None else Scale.named(body.unit, axis.config)
    steps = (
        present(axis, unreferenced=body.unreferenced)
        if body.position is None
        else scale.steps("position", body.position)
    )
    position = NamedPosition(
        name, steps, scale.unit, not body.unreferenced, datetime.now(UTC), asker.reply.name
    )
    await tasks.command(positions.teach(axis, position))
    return views.named_position(axis, position)


@router.delete(
    "/{name}",
    summary="Forget a position",
    dependencies=[Depends(command_headers)],
    responses=problems(*CHANGE, "unknown_position"),
)
async def forget_position(
    axis: AxisDep, name: NameRef, positions: PositionsDep, tasks: TasksDep
) -> NamedPositionReply:
    """Forget it; answers with what it was."""
    return views.named_position(axis, await tasks.command(positions.forget(axis, name)))
