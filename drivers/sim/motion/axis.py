"""One simulated axis: it puts drive, modes, motor and mechanics together, and runs their events in order."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from drivers.cia301.sdo import AbortCode
from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, PowerState
from drivers.sim.interface import AxisParameters, RaiseEmergency
from drivers.sim.motion import readings
from drivers.sim.motion.context import SWITCH_PARAMETERS, VELOCITY_DIMENSION, Context
from drivers.sim.motion.drive import Drive
from drivers.sim.motion.encoder import ENCODER_PARAMETERS, Encoder
from drivers.sim.motion.homing import Homing
from drivers.sim.motion.mode import ModeControl
from drivers.sim.motion.motor import Mark, Motor
from drivers.sim.motion.panel import Panel
from drivers.sim.motion.positioning import ProfilePosition
from drivers.sim.motion.running import CyclicPosition, CyclicVelocity, ProfileVelocity
from drivers.sim.motion.supervision import STALL_OPTION, Supervision
from drivers.sim.motion.travel import AxisSettings, Travel
from drivers.sim.motion.troubles import Conditions, Severity, Trouble, fault_reset, register_of

BRAKE_CURRENTS: Final = 0x200C
_ONLY_DISABLED: Final = (SWITCH_PARAMETERS, ENCODER_PARAMETERS, BRAKE_CURRENTS, VELOCITY_DIMENSION)
_RUNNING: Final = (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE)


class _Next(NamedTuple):
    time: float | None
    mark: Mark | None
    stall: float | None


class SimulatedAxis(Panel):
    """See `drivers.sim.interface.AxisUnit`; the hands on it are `drivers.sim.motion.panel.Panel`.

    State changes at events only: inputs, and the times that `next_event` names. In between everything follows
    in closed form, so it doesn't matter how often, or when, `advance` is called.
    """

    def __init__(
        self,
        axis: int,
        parameters: AxisParameters,
        settings: AxisSettings,
        raise_emergency: RaiseEmergency,
    ) -> None:
        self.axis = axis
        self.settings = settings
        self.travel = Travel(settings)
        self.conditions = Conditions(settings)
        self.motor = Motor(self.travel)
        self.encoder = Encoder(parameters, settings, self.motor)
        self._parameters = parameters
        self._raise = raise_emergency
        self._start()
        self.supervision = Supervision(self.context, settings.load)
        self.changes_mode_at_once = False
        """Whether another mode counts, and 6061h shows it, while the motor still ramps down. Unverified on
        hardware, so a master must live with both.
        """
        self._now = 0.0
        self._next: _Next | None = None

    def _start(self) -> None:
        self.drive = Drive(self._parameters, self)
        self.context = Context(self._parameters, self.travel, self.motor, self.encoder, self.drive)
        self.modes: Mapping[Mode, ModeControl] = {
            Mode.NO_MODE: ModeControl(self.context),
            Mode.PROFILE_POSITION: ProfilePosition(self.context),
            Mode.PROFILE_VELOCITY: ProfileVelocity(self.context),
            Mode.HOMING: Homing(self.context),
            Mode.CYCLIC_SYNC_POSITION: CyclicPosition(self.context),
            Mode.CYCLIC_SYNC_VELOCITY: CyclicVelocity(self.context),
        }
        self.mode = Mode.NO_MODE
        self._mode_ahead: Mode | None = None
        self._latched: frozenset[Trouble] = frozenset()
        self._deviated = False

    # --- the interface to the communication half ------------------------------------------------------------

    @property
    def state(self) -> PowerState:
        """The power state."""
        return self.drive.state

    @property
    def moving(self) -> bool:
        """Whether a leg is under way."""
        return not self.motor.standing

    @property
    def error_register(self) -> int:
        """The bits of 1001h that this axis keeps set."""
        return register_of(self._latched)

    def may_write(self, base_index: int, sub: int, value: int, now: float) -> AbortCode | None:
        """Objects that can be written in some states only (manual §4.2.6, §4.2.8, §4.2.9, §4.2.19)."""
        del sub
        self.advance(now)
        if base_index == objects.MODE and value not in self.modes:
            return AbortCode.INVALID_VALUE
        if base_index in _ONLY_DISABLED and self.state is not PowerState.SWITCH_ON_DISABLED:
            return AbortCode.DEVICE_STATE
        # Unverified on hardware: another source of the actual position in the middle of a move.
        if base_index == objects.SENSOR_SELECTION and self.moving:
            return AbortCode.DEVICE_STATE
        return None

    def written(self, base_index: int, sub: int, value: int, now: float) -> None:
        """Act on an object's new value."""
        del sub
        self.advance(now)
        if base_index == objects.CONTROLWORD:
            self._command(value, now)
        elif base_index == objects.MODE:
            self._select(Mode(value), now)
        elif base_index == objects.SENSOR_SELECTION:
            self._initialise_counter(now)
        elif base_index == SWITCH_PARAMETERS:
            self.supervision.settle(now)
        elif self._mode_ahead is None:
            self._control.written(base_index, now)
        self._settle(now)

    def read(self, base_index: int, sub: int, now: float) -> int | None:
        """The live value of an object."""
        del sub
        reading = readings.LIVE.get(base_index)
        if reading is None:
            return None
        self.advance(now)
        return reading(self, now)

    def advance(self, now: float) -> None:
        """Run all events up to `now`, each at its own time."""
        while (time := self._ahead().time) is not None and time <= now:
            self._step(time)

    def next_event(self, now: float) -> float | None:
        """The next event's time, after those up to `now`."""
        self.advance(now)
        return self._ahead().time

    def sync(self, now: float) -> None:
        """Set points of the cyclic modes count."""
        self.advance(now)
        if self._mode_ahead is None:
            self._control.sync(now)
        self._settle(now)

    def nmt_stopped(self, now: float) -> None:
        """OPERATION_ENABLED becomes FAULT, by way of the fault reaction."""
        self.advance(now)
        if self.state is PowerState.OPERATION_ENABLED:
            self.drive.fault(now, braked=True)
        self._settle(now)

    def reset(self, now: float) -> None:
        """Begin anew: position 0 where the carriage stands. Present troubles are reported anew."""
        self.power_off(now)
        self.context.set_position(0, now)
        self.mode = Mode(self._parameters.get(objects.MODE))
        self.supervision.settle(now)
        self.conditions_changed(now)
        self._settle(now)

    def power_off(self, now: float) -> None:
        """No current, and nothing remembered but where the carriage stands."""
        self.advance(now)
        self.motor.cut(now)
        load = self.supervision.load
        self._start()
        self.supervision = Supervision(self.context, load)
        self.supervision.settle(now)
        self._now, self._next = now, None

    # --- what the power state machine makes it do -----------------------------------------------------------

    def slow_down(self, now: float) -> None:
        """Ramp down as the mode does."""
        self._control.end(now)
        self.motor.pursue(self._control.slow_down(), now)

    def quick_stop(self, now: float) -> None:
        """Ramp down with 6085h."""
        self._control.end(now)
        self.motor.pursue(self._control.quick_stop(), now)

    def cut(self, now: float) -> None:
        """No current any more."""
        self._control.end(now)
        self.motor.cut(now)

    def enabled(self, now: float) -> None:
        """OPERATION_ENABLED."""
        self._initialise_counter(now)
        if self._mode_ahead is None:
            self._control.begin(now)

    def reset_fault(self, now: float) -> bool:
        """A fault whose cause is still there can't be reset (unverified on hardware)."""
        del now
        present = self.conditions.present()
        if any(trouble.value.severity is Severity.CUT for trouble in present):
            return False
        self._latched = present
        self._deviated = False
        self._raise(fault_reset(self.axis))
        return True

    @property
    def standing(self) -> bool:
        """Whether the motor is at rest."""
        return self.motor.standing

    # --- events ---------------------------------------------------------------------------------------------

    @property
    def _control(self) -> ModeControl:
        return self.modes[self.mode]

    @property
    def control(self) -> ModeControl:
        """The mode that is displayed."""
        return self._control

    @property
    def deviated(self) -> bool:
        """Whether a following error happened since the last fault reset."""
        return self._deviated

    def _ahead(self) -> _Next:
        if self._next is None:
            self._next = self._find_next()
        return self._next

    def _find_next(self) -> _Next:
        mark: Mark | None = None
        stall: float | None = None
        if not self.motor.standing:
            stop = self.motor.end_stop_mark()
            marks = (*self.supervision.marks(), *self._control.marks(), *(() if stop is None else (stop,)))
            mark = self.motor.next_mark(marks, self._now)
            if self.state in _RUNNING:
                stall = self.supervision.stall_time(self._now)
        times = (
            self.motor.leg_end,
            None if mark is None else mark.time,
            stall,
            self.drive.deadline,
            self._control.deadline(),
        )
        first = min((time for time in times if time is not None), default=None)
        return _Next(None if first is None else max(first, self._now), mark, stall)

    def _step(self, time: float) -> None:
        ahead = self._ahead()
        self._now = time
        if ahead.mark is not None and time >= ahead.mark.time:
            self.motor.passed(ahead.mark.position)
        end = self.motor.leg_end
        if end is not None and time >= end:
            self.motor.end_leg(time)
        elif ahead.stall is not None and time >= ahead.stall:
            self.stalled(time)
        self._observe(time)
        self._next = None

    def _settle(self, now: float) -> None:
        """After an input: see what it did, and run what follows at once."""
        self._now = now
        self._observe(now)
        self._next = None
        self.advance(now)

    def _observe(self, now: float) -> None:
        for trouble in self.supervision.touched(self._control, now):
            self._limit(trouble, now)
        self._supervise(now)
        self.drive.observe(now)
        if self._mode_ahead is not None and (self.changes_mode_at_once or self.motor.standing):
            self._switch_mode(self._mode_ahead, now)
        self._control.observe(now)
        self._supervise(now)

    def _supervise(self, now: float) -> None:
        for trouble in self.supervision.barred(self._control, now):
            self._limit(trouble, now)
        if self.state in _RUNNING and self.supervision.deviates(now):
            self._deviated = True
            self.report(Trouble.FOLLOWING_ERROR, now)

    def _limit(self, trouble: Trouble, now: float) -> None:
        if self.state in _RUNNING:
            self.report(trouble, now)

    # --- what it does ---------------------------------------------------------------------------------------

    def _command(self, word: int, now: float) -> None:
        previous = self.drive.word
        faulty = self.state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
        self.drive.command(word, now)
        if word & ~previous & Controlword.FAULT_RESET and not faulty and self._latched:
            # Warnings leave no fault; a reset forgets them all the same (unverified on hardware).
            self.reset_fault(now)
        if self._mode_ahead is None:
            self._control.control(previous, word, now)

    def _select(self, mode: Mode, now: float) -> None:
        """Another mode: a running motor is ramped down first (unverified on hardware).

        Until then set points are ignored, and 6061h shows the old mode, but for `changes_mode_at_once`.
        """
        if mode == self.mode and self._mode_ahead is None:
            return
        self._mode_ahead = mode
        if self.drive.active and not self.motor.standing:
            self.slow_down(now)

    def _switch_mode(self, mode: Mode, now: float) -> None:
        self._mode_ahead = None
        self._control.end(now)
        left = self._control
        if isinstance(left, Homing):
            left.forget()
        self.mode = mode
        if self.drive.active:
            self._control.begin(now)

    def report(self, trouble: Trouble, now: float) -> None:
        """Send the EMCY and do what the trouble asks for."""
        self._latched |= {trouble}
        self._raise(trouble.emergency(self.axis, self.error_register))
        severity = trouble.value.severity
        if severity is not Severity.WARNING:
            self.drive.fault(now, braked=severity is Severity.RAMP)

    def stalled(self, now: float) -> None:
        """Stop on stall: the motor stands at once; 20A7h says what else."""
        if self._parameters.get(STALL_OPTION) == 0:
            self.report(Trouble.STALL, now)
        else:
            self._control.end(now)
            self.motor.cut(now)

    def _initialise_counter(self, now: float) -> None:
        """200Bh:3: take the encoder's position over, if the two differ by more than an increment.

        When the encoder is selected, and whenever the drive is enabled: unverified on hardware.
        """
        if self.motor.standing and self.encoder.initialises_counter and self.encoder.disagrees(now):
            self.motor.relocate(self.encoder.shown(now), now)

    def conditions_changed(self, now: float) -> None:
        """Report what is new among the electrical troubles."""
        for trouble in sorted(self.conditions.present() - self._latched, key=lambda t: t.name):
            self.report(trouble, now)

    def touched(self, now: float) -> None:
        """Something outside changed: see what it does."""
        self._settle(now)
