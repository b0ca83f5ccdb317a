"""An axis that is jogged, as its client sees it."""

from __future__ import annotations

from app.axes.schemas import Limits, Quantity
from app.axes.units import Scale
from app.http.paths import operation_path
from app.jog.schemas import JogState, JogStatusMessage
from drivers.master.axis.axis import Axis
from drivers.master.motions.jogging import Jog


def status(stamp: float, axis: Axis, state: JogState, jog: Jog | None) -> JogStatusMessage:
    """What the axis does."""
    seen = axis.status
    position, velocity = where(axis)
    return JogStatusMessage(
        stamp=stamp,
        jog=state,
        state=None if seen.state is None else seen.state.value,
        position=position,
        velocity=velocity,
        moving=seen.moving,
        limits=Limits(negative=seen.switches.negative_limit, positive=seen.switches.positive_limit),
        stale=seen.stale,
        operation=None if jog is None else operation_path(jog.id),
    )


def where(axis: Axis) -> tuple[Quantity | None, Quantity | None]:
    """Position and velocity."""
    seen, scale = axis.status, Scale.of(axis.config)
    return (
        None if seen.position is None else scale.quantity(seen.position),
        None if seen.velocity is None else scale.quantity(seen.velocity, "/s"),
    )


def ms(seconds: float | None) -> float | None:
    """Seconds as the messages have them."""
    return None if seconds is None else round(seconds * 1000, 3)
