"""Named positions: taught, listed, gone to. The store keeps them; what it said is known here as well.

While the store is off, what is known goes on being used, and nothing is changed. A change counts once it is
durable; one that was not seen to be so may have been written all the same, so the store is read again as soon
as it can be.
"""

from __future__ import annotations

from app.http.problems import ApiError
from app.positions import table as records
from app.positions.table import NamedPosition, Place
from app.store.database import Database, StoreOff
from app.store.sqlite import Statement
from drivers.errors import CanaxisError, NodeAway, NotReady, Obstacle
from drivers.master.axis.axis import Axis
from drivers.master.seen.status import NodeState
from drivers.obstacles import (
    NOT_REFERENCED_FOR_GOING,
    NOT_REFERENCED_FOR_TEACHING,
    STALE_FOR_TEACHING,
    TURNING_AT_TEACHING,
)

_NOT_HOMED = "The axis was not homed since the module's last reset."
MOST = 2048
"""Positions of one axis: enough for a plate of 1536 wells."""


def place_of(axis: Axis) -> Place:
    """What the positions of an axis are kept under."""
    return axis.node.node_id, axis.number


class Positions:
    """The named positions of every axis."""

    def __init__(self, store: Database) -> None:
        self._store = store
        self._known: dict[Place, dict[str, NamedPosition]] | None = None
        self._current = False
        """Whether the store holds just what is known here, as far as can be told."""
        store.on_return.append(self._doubt)

    async def all_of(self, axis: Axis) -> list[NamedPosition]:
        """Every position of an axis, by name. Raises `ApiError` (503) if the store was never read."""
        known = await self._look()
        return sorted(known.get(place_of(axis), {}).values(), key=lambda position: position.name)

    async def find(self, axis: Axis, name: str) -> NamedPosition:
        """One position. Raises `ApiError` (404, 503)."""
        found = (await self._look()).get(place_of(axis), {}).get(name)
        if found is None:
            raise ApiError("unknown_position", f"Axis {axis.name} has no position {name!r}.")
        return found

    async def teach(self, axis: Axis, position: NamedPosition) -> None:
        """Keep a position, in place of one of that name. Raises `ApiError` (409, 503), `BadValue`."""
        axis.check_position(position.steps)
        own = (await self._look()).get(place_of(axis), {})
        if len(own) >= MOST and position.name not in own:
            raise ApiError(
                "not_ready", f"Axis {axis.name} has {MOST} positions already.", hint="Delete some."
            )
        known = await self._change(records.written(place_of(axis), position))
        known.setdefault(place_of(axis), {})[position.name] = position

    async def forget(self, axis: Axis, name: str) -> NamedPosition:
        """Forget a position; returns what it was. Raises `ApiError` (404, 503)."""
        found = await self.find(axis, name)
        known = await self._change(records.removed(place_of(axis), name))
        known.get(place_of(axis), {}).pop(name, None)
        return found

    # --- inside ---

    async def _look(self) -> dict[Place, dict[str, NamedPosition]]:
        if not self._current:
            try:
                found = await records.everything(self._store)
            except StoreOff as off:
                if self._known is None:
                    raise ApiError("store_off", f"The positions can't be read: {off}") from off
                return self._known
            self._known = {place: dict(positions) for place, positions in found.items()}
            self._current = True
        assert self._known is not None, "what is current was read"
        return self._known

    async def _change(self, statement: Statement) -> dict[Place, dict[str, NamedPosition]]:
        """Have a change written; returns what is known, so that it is changed there as well."""
        if not await self._store.commit(statement):
            self._doubt()
            raise ApiError("store_off", f"The change could not be kept: {self._store.health.reason}")
        return await self._look()

    def _doubt(self) -> None:
        self._current = False


def present(axis: Axis, *, unreferenced: bool) -> int:
    """Where an axis stands, steps, for teaching. Raises `NodeAway`, or `NotReady` if that can't be relied on.

    `unreferenced`: take it though the axis was not homed.
    """
    status, node = axis.status, axis.node
    if node.state is not NodeState.OPERATIONAL:
        raise NodeAway(
            f"Node {node.name} is {node.state}: {node.reason}", node=node.node_id, axis=axis.number
        )
    found: list[Obstacle] = []
    if status.stale or status.position is None:
        found.append(STALE_FOR_TEACHING.found("The axis's status is too old to be trusted."))
    if status.moving or axis.errand is not None:
        found.append(TURNING_AT_TEACHING.found("The axis is in use."))
    if not status.referenced and not unreferenced:
        found.append(NOT_REFERENCED_FOR_TEACHING.found(_NOT_HOMED))
    if found or status.position is None:
        raise _refusal(axis, "is not taught where it is", found)
    return status.position


def check_going(axis: Axis, position: NamedPosition) -> None:
    """Raise `NotReady` where the axis counts from elsewhere than when the position was taught."""
    if position.needs_reference and not axis.status.referenced:
        found = [NOT_REFERENCED_FOR_GOING.found(_NOT_HOMED)]
        raise _refusal(axis, f"is not sent to {position.name!r}", found)


def _refusal(axis: Axis, what: str, found: list[Obstacle]) -> CanaxisError:
    return NotReady(
        f"Axis {axis.name} {what}: {' '.join(obstacle.message for obstacle in found)}",
        hint=" ".join(obstacle.remedy for obstacle in found),
        obstacles=tuple(found),
        node=axis.node.node_id,
        axis=axis.number,
    )
