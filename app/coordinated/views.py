"""Coordinated moves as the wire shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

from app.axes import views
from app.axes.schemas import Quantity
from app.axes.units import Scale
from app.coordinated.schemas import MovesPrediction, PredictedAxis
from app.moves.schemas import PathReply
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import Operation
from drivers.master.together.coordinated_prediction import CoordinatedPrediction
from drivers.master.together.member import Member

_SUFFIXES = {"position": "", "target": "", "velocity": "/s", "acceleration": "/s2", "deceleration": "/s2"}


def result(motion: Operation, taking_part: Sequence[Axis]) -> dict[str, Any]:
    """What came of it, with each axis's units beside its numbers."""
    assert motion.result is not None
    rows = cast("list[Mapping[str, Any]]", motion.result["axes"])
    axes: list[dict[str, Any]] = []
    for axis, row in zip(taking_part, rows, strict=True):
        scale = Scale.of(axis.config)
        axes.append(
            {
                key: scale.quantity(value, _SUFFIXES[key]).model_dump()
                if key in _SUFFIXES and value is not None
                else value
                for key, value in row.items()
            }
        )
    return {**motion.result, "axes": axes}


def prediction(found: CoordinatedPrediction) -> MovesPrediction:
    """What it would be, and what prevents it now."""
    prevented = dict(found.hindrances)
    spread = found.coordination.spread_s if found.coordination.profiles else 0.0
    return MovesPrediction(
        dry_run=True,
        ready=not prevented,
        predicted_s=round(found.coordination.duration_s, 4),
        spread_s=round(spread, 4),
        axes=[
            _axis(member).model_copy(
                update={"obstacles": views.obstacles(member.axis, prevented.get(member.axis, ()))}
            )
            for member in found.members
        ],
    )


def _axis(member: Member) -> PredictedAxis:
    axis, profile = member.axis, member.profile
    scale, limits = Scale.of(axis.config), axis.config.target_range
    low, high = sorted((member.start, member.target))

    def rate(value: int | None, suffix: str) -> Quantity | None:
        return None if value is None else scale.quantity(value, suffix)

    return PredictedAxis(
        node=axis.node.node_id,
        axis=axis.number,
        name=axis.name,
        start=scale.quantity(member.start),
        target=scale.quantity(member.target),
        velocity=rate(profile and profile.velocity, "/s"),
        acceleration=rate(profile and profile.acceleration, "/s2"),
        deceleration=rate(profile and profile.deceleration, "/s2"),
        predicted_s=None if profile is None else round(profile.duration_s, 4),
        path=PathReply(
            lowest=scale.quantity(low),
            highest=scale.quantity(high),
            limit_low=scale.quantity(limits[0]),
            limit_high=scale.quantity(limits[1]),
            within=limits[0] <= low and high <= limits[1],
        ),
        writes=[views.change(one) for one in member.changes()],
        obstacles=[],
    )
