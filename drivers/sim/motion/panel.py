"""The hands on an axis, for tests and the fault panel: on its switches, carriage and supply."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.sim.motion.troubles import Bridge, Conditions

if TYPE_CHECKING:
    from drivers.sim.motion.motor import Motor
    from drivers.sim.motion.supervision import Supervision
    from drivers.sim.motion.travel import SwitchName, Travel


class Panel:
    """Controls of one axis. Each takes effect at `now` and stays until it is undone."""

    travel: Travel
    conditions: Conditions
    motor: Motor
    supervision: Supervision
    _blocked = False

    @property
    def blocked(self) -> bool:
        """Whether something holds the carriage."""
        return self._blocked

    def advance(self, now: float) -> None:
        """Run all events up to `now`."""
        raise NotImplementedError

    def touched(self, now: float) -> None:
        """See what a change from outside does."""
        raise NotImplementedError

    def conditions_changed(self, now: float) -> None:
        """Report what is new among the electrical troubles."""
        raise NotImplementedError

    def stalled(self, now: float) -> None:
        """Stop on stall."""
        raise NotImplementedError

    def press_switch(self, switch: SwitchName, now: float) -> None:
        """Press ``home``, ``negative`` or ``positive`` by hand."""
        self.advance(now)
        self.travel.press(switch)
        self.touched(now)

    def release_switch(self, switch: SwitchName, now: float) -> None:
        """Release a pressed switch."""
        self.advance(now)
        self.travel.release(switch)
        self.touched(now)

    def block(self, now: float) -> None:
        """Hold the carriage: the motor's counter goes on, an encoder stands."""
        self.advance(now)
        self._blocked = True
        self.motor.hold(now)
        self.touched(now)

    def unblock(self, now: float) -> None:
        """Let the carriage go; the steps lost stay lost."""
        self.advance(now)
        self._blocked = False
        self._release(now)
        self.touched(now)

    def load_torque(self, share: float, now: float) -> None:
        """The load as a share of the motor's torque, >= 0; from 1 on the motor can't move the carriage."""
        if share < 0:
            raise ValueError(f"a load of {share} drives the motor; 0 is the least")
        self.advance(now)
        self.supervision.load = share
        if share >= 1.0:
            self.motor.hold(now)
        else:
            self._release(now)
        self.touched(now)

    def stall(self, now: float) -> None:
        """As if StallGuard had found a stall just now, whatever 20A4h is; a standing motor can't stall."""
        self.advance(now)
        if not self.motor.standing:
            self.stalled(now)
        self.touched(now)

    def supply(self, voltage: float, now: float) -> None:
        """The motor supply in volts; below `Conditions.UNDERVOLTAGE` it is too low to drive a motor."""
        self.advance(now)
        self.conditions.voltage = voltage
        self._conditions(now)

    def temperature(self, celsius: float, now: float) -> None:
        """The driver's temperature; `Conditions.WARM` and `Conditions.HOT` are the limits."""
        self.advance(now)
        self.conditions.temperature = celsius
        self._conditions(now)

    def short(self, bridge: Bridge, now: float) -> None:
        """A short circuit on bridge ``a`` or ``b``, or on the ``high`` side."""
        self.advance(now)
        self.conditions.shorts.add(bridge)
        self._conditions(now)

    def open_load(self, bridge: Bridge, now: float) -> None:
        """A wire off bridge ``a`` or ``b``."""
        if bridge == "high":
            raise ValueError("the high side has no load of its own")
        self.advance(now)
        self.conditions.open_loads.add(bridge)
        self._conditions(now)

    def mend(self, now: float) -> None:
        """Undo every short circuit and open load."""
        self.advance(now)
        self.conditions.shorts.clear()
        self.conditions.open_loads.clear()
        self._conditions(now)

    def shutdown_input(self, active: bool, now: float) -> None:
        """The module's shutdown switch, as this axis sees it: True takes the enable signal away."""
        self.advance(now)
        self.conditions.shutdown = active
        self._conditions(now)

    def _conditions(self, now: float) -> None:
        self.conditions_changed(now)
        self.touched(now)

    def _release(self, now: float) -> None:
        if not self._blocked and self.supervision.load < 1.0:
            self.motor.let_go(now)
