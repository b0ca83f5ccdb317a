"""Homing mode: the twelve methods as rows over one search (manual §8)."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from drivers.cia402 import objects
from drivers.cia402.power import Controlword, Statusword
from drivers.sim.motion.context import Context
from drivers.sim.motion.goals import RunAt, Stop
from drivers.sim.motion.mode import ModeControl
from drivers.sim.motion.travel import HALF, Levels, SwitchName

HERE: Final = 35
"""The method that takes the position as home without moving."""


@dataclass(frozen=True, slots=True)
class Search:
    """What a method looks for."""

    switch: SwitchName | None
    """The switch whose edge counts; None goes for the index pulse at once."""
    seek: int
    """Direction towards the switch, which is then left the other way; without a switch, where to look."""
    index: bool = False
    """Whether home is the next index pulse in the direction in which the edge was left."""


SEARCHES: Final[Mapping[int, Search]] = MappingProxyType(
    {
        1: Search("negative", -1, index=True),
        2: Search("positive", +1, index=True),
        3: Search("home", +1, index=True),
        5: Search("home", -1, index=True),
        17: Search("negative", -1),
        18: Search("positive", +1),
        19: Search("home", +1),
        21: Search("home", -1),
        33: Search(None, -1, index=True),
        34: Search(None, +1, index=True),
    }
)
"""Every method that moves. Methods 0 and 35 don't."""


class Phase(enum.Enum):
    """How far a homing is."""

    IDLE = enum.auto()
    SEEK = enum.auto()
    """Fast, towards the switch, turning round at limit switches."""
    LEAVE = enum.auto()
    """Slow, off the switch, until it is left."""
    INDEX = enum.auto()
    """Slow, on to the next index pulse."""
    STOPPING = enum.auto()
    """Bit 4 was cleared: ramping down."""
    STOPPED = enum.auto()
    ATTAINED = enum.auto()


_RUNNING: Final = (Phase.SEEK, Phase.LEAVE, Phase.INDEX)


class Homing(ModeControl):
    """Searches while bit 4 is set.

    Home is the first microstep on which the switch is inactive, or the index pulse. Its position becomes
    -607Ch: the zero position lies 607Ch beyond it (manual §8.2.4, and the formula in §6.1.11), with method 35
    too, whose home is the present position (§8.1.10). The index pulse is searched with the slow speed. A home
    switch that isn't found is searched to and fro between the limit switches without end. All of this is
    unverified on hardware.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.phase = Phase.IDLE
        self._search = SEARCHES[19]
        self._way = 0
        self._armed = False
        self._index_place: int | None = None
        self._wanted = False
        """Bit 4 rose while the drive could not start, and is still set."""

    @property
    def ignores_software_limits(self) -> bool:
        """While searching."""
        return self.phase in _RUNNING

    def slow_down(self) -> Stop:
        """With 609Ah."""
        return Stop(self.context.acceleration(objects.HOMING_ACCELERATION), wait=self.context.ramp_wait)

    def begin(self, now: float) -> None:
        """Bit 4 may have risen before a delay let the drive become OPERATION_ENABLED."""
        if self._wanted:
            self._start(now)

    def end(self, now: float) -> None:
        """A running homing is given up: neither stopped nor attained."""
        del now
        if self.phase is not Phase.ATTAINED:
            self.phase = Phase.IDLE

    def forget(self) -> None:
        """The mode was left: outcomes count no more."""
        self._wanted = False
        self.phase = Phase.IDLE

    def control(self, previous: int, word: int, now: float) -> None:
        """Bit 4 starts and stops. Halt is not supported."""
        if not word & Controlword.START_HOMING:
            self._wanted = False
        if word & ~previous & Controlword.START_HOMING and self.phase not in _RUNNING:
            self._wanted = True
            self._start(now)
        elif previous & ~word & Controlword.START_HOMING and self.phase in _RUNNING:
            self.phase = Phase.STOPPING
            self.context.motor.pursue(self.slow_down(), now)
            self.observe(now)

    def observe(self, now: float) -> None:
        """Carry the search on."""
        if self.phase is Phase.SEEK:
            self._seek(now)
        if self.phase is Phase.LEAVE:
            self._leave(now)
        if self.phase is Phase.INDEX:
            self._look_for_index(now)
        if self.phase is Phase.STOPPING and self.context.motor.standing:
            self.phase = Phase.STOPPED

    def marks(self) -> Iterable[float]:
        """The index pulse that is searched."""
        mark = self._index_mark()
        return () if mark is None else self.context.motor.place_marks((mark,))

    def bits(self, now: float) -> int:
        """Bit 10: found, or stopped by bit 4; bit 12: found."""
        del now
        if self.phase is Phase.ATTAINED:
            return Statusword.TARGET_REACHED | Statusword.BIT12
        return Statusword.TARGET_REACHED if self.phase is Phase.STOPPED else 0

    def expects_limit(self, direction: int) -> bool:
        """Both for a home switch, its own for a limit switch, none for an index pulse alone."""
        if self.phase not in (*_RUNNING, Phase.STOPPING):
            return False
        switch = self._search.switch
        return switch == "home" or switch == ("positive" if direction > 0 else "negative")

    def _start(self, now: float) -> None:
        method = self.context.parameters.get(objects.HOMING_METHOD)
        if method == HERE:
            self._wanted = False
            if self.context.motor.standing:
                self._zero_from_here(now)
                self.phase = Phase.ATTAINED
            return
        search = SEARCHES.get(method)
        if search is None or not self.context.drive.active:
            return
        self._wanted = False
        self._search = search
        self._way = search.seek
        if search.switch is None:
            self._begin_index(search.seek, now)
            self._run(search.seek, 2, now)
        else:
            self.phase = Phase.SEEK
            self._run(self._way, 1, now)
        self.observe(now)

    def _seek(self, now: float) -> None:
        levels = self.context.levels(now)
        if _active(levels, self._search.switch):
            self.phase = Phase.LEAVE
            self._armed = True
            self._run(-self._search.seek, 2, now)
        elif self._search.switch == "home" and (levels.positive if self._way > 0 else levels.negative):
            self._way = -self._way
            self._run(self._way, 1, now)

    def _leave(self, now: float) -> None:
        levels = self.context.levels(now)
        active = _active(levels, self._search.switch)
        away = -self._search.seek
        if self.context.motor.direction != away:
            # Still braking; a switch that was crossed meanwhile must be met again on the way back.
            self._armed = active
            return
        if active:
            self._armed = True
        elif self._armed:
            if self._search.index:
                self._begin_index(away, now)
            else:
                self._found(now)
        elif self._search.switch == "home" and (levels.positive if away > 0 else levels.negative):
            self.phase = Phase.SEEK
            self._way = -away
            self._run(self._way, 1, now)

    def _begin_index(self, direction: int, now: float) -> None:
        self.phase = Phase.INDEX
        self._way = direction
        self._index_place = self.context.travel.next_index(self.context.motor.place(now), direction)

    def _look_for_index(self, now: float) -> None:
        mark = self._index_mark()
        if mark is not None and (self.context.motor.place(now) - mark) * self._way > 0:
            self._found(now)

    def _index_mark(self) -> float | None:
        if self.phase is not Phase.INDEX or self._index_place is None:
            return None
        return self._index_place - HALF * self._way

    def _found(self, now: float) -> None:
        self.context.motor.cut(now)
        self._zero_from_here(now)
        self.phase = Phase.ATTAINED

    def _zero_from_here(self, now: float) -> None:
        self.context.set_position(-self.context.parameters.get(objects.HOME_OFFSET), now)

    def _run(self, direction: int, speed: int, now: float) -> None:
        context = self.context
        context.motor.pursue(
            RunAt(
                direction * context.velocity(objects.HOMING_SPEEDS, speed),
                context.acceleration(objects.HOMING_ACCELERATION),
                wait=context.ramp_wait,
            ),
            now,
        )


def _active(levels: Levels, switch: SwitchName | None) -> bool:
    return switch is not None and bool(getattr(levels, switch))
