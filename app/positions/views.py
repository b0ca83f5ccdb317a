"""Named positions as the wire shows them."""

from __future__ import annotations

from app.axes.units import Scale
from app.positions.schemas import NamedPositionReply
from app.positions.table import NamedPosition
from drivers.master.axis.axis import Axis


def named_position(axis: Axis, position: NamedPosition) -> NamedPositionReply:
    """One named position of an axis."""
    per_unit = axis.config.units.get(position.unit)
    scale = Scale.of(axis.config) if per_unit is None else Scale(position.unit, per_unit)
    low, high = axis.config.target_range
    return NamedPositionReply(
        name=position.name,
        position=scale.quantity(position.steps),
        unreferenced=not position.needs_reference,
        within_limits=low <= position.steps <= high,
        taught=position.taught,
        taught_by=position.taught_by,
    )
