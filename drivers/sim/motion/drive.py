"""The power drive state machine of one axis, and what takes time in it (manual §6.1, §5.1)."""

from __future__ import annotations

from typing import Final, Protocol

from drivers.cia402 import objects
from drivers.cia402.power import Command, PowerState, command_of, transition
from drivers.sim.interface import AxisParameters

BRAKE_DELAYS: Final = 0x2002
ENABLE_DELAY: Final = 0x200A
_OVERTAKING: Final = (Command.DISABLE_VOLTAGE, Command.QUICK_STOP)


class Stage(Protocol):
    """What the state machine makes the rest of the axis do."""

    def slow_down(self, now: float) -> None:
        """Ramp down with the deceleration of the mode; follow no set points any more."""
        ...

    def quick_stop(self, now: float) -> None:
        """Ramp down with 6085h; follow no set points any more."""
        ...

    def cut(self, now: float) -> None:
        """Take the current away: stand at once; follow no set points any more."""
        ...

    def enabled(self, now: float) -> None:
        """OPERATION_ENABLED was reached: follow set points."""
        ...

    def reset_fault(self, now: float) -> bool:
        """Forget what was reported and say so; False while a cause is still there."""
        ...

    @property
    def standing(self) -> bool:
        """Whether the motor is at rest."""
        ...


class Drive:
    """Controlwords in, states out.

    A change that takes time (a ramp, a brake) is completed before the next command is looked at, as the
    manual has it (notes to figure 9); disable voltage and quick stop overtake it, which is unverified on
    hardware. Of commands that have to wait only the last counts. Brake and enable delays apply whether or not
    200Ch feeds a brake.
    """

    def __init__(self, parameters: AxisParameters, stage: Stage) -> None:
        self._parameters = parameters
        self._stage = stage
        self.state = PowerState.SWITCH_ON_DISABLED
        self.word = 0
        self._taken = 0
        self._ahead: PowerState | None = None
        self._due: float | None = None

    @property
    def active(self) -> bool:
        """Whether set points are followed: OPERATION_ENABLED, and not on the way out of it."""
        return self.state is PowerState.OPERATION_ENABLED and self._ahead is None

    @property
    def powered(self) -> bool:
        """Whether the motor has current."""
        return self._ahead is PowerState.OPERATION_ENABLED or self.state in (
            PowerState.OPERATION_ENABLED,
            PowerState.QUICK_STOP_ACTIVE,
            PowerState.FAULT_REACTION_ACTIVE,
        )

    @property
    def deadline(self) -> float | None:
        """When a delay ends; call `observe` then."""
        return self._due

    def command(self, word: int, now: float) -> None:
        """A controlword was written."""
        self.word = word
        if self._ahead is None or command_of(word) in _OVERTAKING:
            self._take(now)

    def fault(self, now: float, *, braked: bool) -> None:
        """Something is wrong: ramp down with current if `braked` and there is any, else cut; then FAULT."""
        if self.state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE) and braked:
            return
        if braked and self.state in (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE):
            self.state = PowerState.FAULT_REACTION_ACTIVE
            self._ahead, self._due = PowerState.FAULT, None
            self._stage.quick_stop(now)
            self.observe(now)
            return
        self._cut(PowerState.FAULT, now)

    def observe(self, now: float) -> None:
        """Complete what is due."""
        if self._ahead is None:
            return
        if self._due is None and self._stage.standing:
            self._due = now + self._milliseconds(BRAKE_DELAYS, 1)
        if self._due is None or now < self._due:
            return
        reached, self._ahead, self._due = self._ahead, None, None
        if reached is PowerState.OPERATION_ENABLED:
            self.state = reached
            self._stage.enabled(now)
        else:
            self._cut(reached, now)
        if self.word != self._taken:
            self._take(now)

    def _take(self, now: float) -> None:
        previous, self._taken = self._taken, self.word
        ahead = transition(self.state, self.word, previous)
        if ahead is None:
            return
        if self.state is PowerState.FAULT:
            if self._stage.reset_fault(now):
                self.state = ahead
        elif ahead is PowerState.OPERATION_ENABLED:
            self._enable(now)
        elif ahead is PowerState.QUICK_STOP_ACTIVE:
            self._quick_stop(now)
        elif self.state is PowerState.OPERATION_ENABLED and ahead is PowerState.SWITCHED_ON:
            self._ahead, self._due = ahead, None
            self._stage.slow_down(now)
            self.observe(now)
        elif self.powered:
            self._cut(ahead, now)
        else:
            self.state = ahead

    def _enable(self, now: float) -> None:
        if self.state is PowerState.QUICK_STOP_ACTIVE:
            self.state = PowerState.OPERATION_ENABLED
            self._stage.enabled(now)
            return
        self.state = PowerState.SWITCHED_ON
        self._ahead = PowerState.OPERATION_ENABLED
        self._due = now + self._milliseconds(ENABLE_DELAY, 0) + self._milliseconds(BRAKE_DELAYS, 2)
        self.observe(now)

    def _quick_stop(self, now: float) -> None:
        option = self._parameters.get(objects.QUICK_STOP_OPTION)
        self.state = PowerState.QUICK_STOP_ACTIVE
        self._ahead, self._due = (PowerState.SWITCH_ON_DISABLED if option in (1, 2) else None), None
        if option in (1, 5):
            self._stage.slow_down(now)
        else:
            self._stage.quick_stop(now)
        self.observe(now)

    def _cut(self, state: PowerState, now: float) -> None:
        self.state = state
        self._ahead = self._due = None
        self._stage.cut(now)

    def _milliseconds(self, index: int, sub: int) -> float:
        return self._parameters.get(index, sub) / 1000.0
