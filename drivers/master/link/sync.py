"""The SYNC that the master produces, who of us may, and whether somebody else does (CiA 301 7.2.5).

Every SYNC starts whatever waits in a synchronous RPDO of any node. So one of our users at a time has it:
a group of axes for the moment of its start, a trajectory for as long as it lasts.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterable
from typing import Protocol

from drivers.bus.frame import Frame
from drivers.cia301 import cob, sync
from drivers.errors import BusError, NotReady, Obstacle
from drivers.obstacles import SET_POINT_WAITS, SYNC_IN_USE

Send = Callable[[Frame], None]
"""Puts a frame on the bus; raises `BusError`."""


class SyncedAxis(Protocol):
    """An axis as the SYNC knows it: its module takes with the next one what was prepared for it."""

    @property
    def name(self) -> str:
        """For people."""
        ...

    @property
    def node_name(self) -> str:
        """For people."""
        ...

    @property
    def in_reach(self) -> bool:
        """Whether its module takes PDOs."""
        ...

    @property
    def set_point_waits(self) -> bool:
        """Whether a set point may wait in the module for a SYNC."""
        ...

    def prepare_over(self) -> None:
        """Put what changes nothing over it. Raises `BusError`."""
        ...

    def note_taken(self) -> None:
        """Nothing waits any more."""
        ...


class SyncProducer:
    """Sends SYNCs (080h, no counter) for whoever has claimed it, and counts those of others."""

    def __init__(self, send: Send, withdraw: Callable[[Collection[int]], object]) -> None:
        self._send = send
        self._withdraw = withdraw
        self._frame = Frame(cob.SYNC, sync.encode())
        self.user: str | None = None
        """Who has it now, for people."""
        self.foreign = 0
        """SYNCs of somebody else on the bus so far."""
        self._axes: list[SyncedAxis] = []

    def watch(self, axis: SyncedAxis) -> None:
        """An axis of the bus, in whose module a set point may wait for a SYNC."""
        self._axes.append(axis)

    def obstacles(self) -> tuple[Obstacle, ...]:
        """What prevents a claim now."""
        if self.user is not None:
            return (SYNC_IN_USE.found(f"The SYNC of the bus is in use by {self.user}."),)
        owed = [axis for axis in self._axes if axis.set_point_waits]
        return tuple(
            SET_POINT_WAITS.found(
                f"A set point may still wait in node {axis.node_name} for a SYNC, which would move axis "
                f"{axis.name}: the node went out of reach in the middle of a motion."
            )
            for axis in owed
        )

    def make_harmless(self, axes: Iterable[SyncedAxis]) -> None:
        """Put what changes nothing over a set point that may wait in a module, and have that taken.

        For the axes that can be reached; the others still owe it (`obstacles`), until they are back.
        """
        owing = [axis for axis in axes if axis.set_point_waits and axis.in_reach]
        if not owing:
            return
        with contextlib.suppress(BusError):
            for axis in owing:
                axis.prepare_over()
            self.send()
            for axis in owing:
                axis.note_taken()

    def claim(self, user: str) -> None:
        """Have it for oneself until `release`. Raises `NotReady` while somebody else has it."""
        if found := self.obstacles():
            raise NotReady(found[0].message, obstacles=found)
        self.user = user

    def release(self, user: str) -> None:
        """Give it back; nothing happens if `user` hasn't got it."""
        if self.user == user:
            self.user = None

    def send(self) -> None:
        """One SYNC, behind what waits to be sent already. Raises `BusError`."""
        self._send(self._frame)

    def withdraw(self) -> None:
        """Take back a SYNC that the bus did not take yet."""
        self._withdraw((cob.SYNC,))

    def on_sync(self, _: Frame) -> None:
        """A SYNC came; our own don't come back to us."""
        self.foreign += 1
