"""What was seen of the axes during an operation, as the API shows it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from app.axes.schemas import Quantity
from app.axes.units import Scale
from app.operations.schemas import AxisTrack, EvidenceReply, FoundAxis, SeenEmergency, SightReply
from drivers.master.axis.axis import Axis
from drivers.master.ground.where import AxisId
from drivers.master.seen.evidence import Evidence


def nothing() -> EvidenceReply:
    """Before anything was seen."""
    return EvidenceReply(axes=[], statuswords=[], left_out=0, emergencies=[])


def reply(seen: Evidence, axes: Sequence[Axis]) -> EvidenceReply:
    """What was seen so far of these axes."""
    scales = {axis.id: Scale.of(axis.config) for axis in axes}

    def place(axis: AxisId, steps: int | None) -> Quantity | None:
        return None if steps is None else scales[axis].quantity(steps)

    return EvidenceReply(
        axes=[
            AxisTrack(
                node=track.axis.node,
                axis=track.axis.number,
                start=place(track.axis, track.start),
                target=place(track.axis, track.target),
                end=place(track.axis, track.end),
            )
            for track in seen.tracks.values()
        ],
        statuswords=[
            SightReply(
                node=sight.axis.node,
                axis=sight.axis.number,
                after_s=round(sight.after_s, 4),
                statusword=f"0x{sight.statusword:04X}",
                position=place(sight.axis, sight.position),
            )
            for sight in seen.trail
        ],
        left_out=seen.left_out,
        emergencies=[
            SeenEmergency(node=e.node, axis=e.axis, time=e.time, code=f"0x{e.code:04X}", title=e.title)
            for e in seen.emergencies
        ],
    )


def with_found(known: EvidenceReply, axis: Axis, now: datetime) -> EvidenceReply:
    """The evidence with an axis as it was found after a restart."""
    status = axis.status
    found = FoundAxis(
        node=axis.node.node_id,
        axis=axis.number,
        time=now,
        state=None if status.state is None else status.state.value,
        moving=status.moving,
        position=_quantity(axis, status.position),
        velocity=_quantity(axis, status.velocity, "/s"),
    )
    return known.model_copy(update={"found": [*known.found, found]})


def _quantity(axis: Axis, steps: int | None, suffix: str = "") -> Quantity | None:
    return None if steps is None else Scale.of(axis.config).quantity(steps, suffix)
