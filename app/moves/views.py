"""Dry runs of the commands that move one axis, as the wire shows them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.axes.schemas import Quantity
from app.axes.units import Scale
from app.axes.views import change, obstacles, peak
from app.moves.schemas import PathReply, PreviewReply
from drivers.master.axis.axis import Axis
from drivers.master.axis.outlook import Preview


def preview(kind: str, axis: Axis, seen: Preview, asked: Mapping[str, Any]) -> PreviewReply:
    """What a command would come to."""
    scale = Scale.of(axis.config)

    def place(steps: int | None) -> Quantity | None:
        return None if steps is None else scale.quantity(steps)

    expected = seen.prediction
    path = None
    if expected is not None and expected.path is not None and seen.within is not None:
        path = PathReply(
            lowest=scale.quantity(expected.path[0]),
            highest=scale.quantity(expected.path[1]),
            limit_low=scale.quantity(seen.limits[0]),
            limit_high=scale.quantity(seen.limits[1]),
            within=seen.within,
        )
    return PreviewReply(
        dry_run=True,
        kind=kind,
        node=axis.node.node_id,
        axis=axis.number,
        name=axis.name,
        accepted=seen.admission is not None,
        begins=None if seen.admission is None else seen.admission.value,
        obstacles=obstacles(axis, seen.obstacles),
        request=dict(asked),
        predicted_s=None if expected is None else round(expected.duration_s, 4),
        predicted_peak_velocity=peak(axis, expected),
        start=None if expected is None else place(expected.start),
        end=None if expected is None else place(expected.end),
        path=path,
        assumed=[] if expected is None else list(expected.assumed),
        writes=[change(one) for one in seen.changes],
    )
