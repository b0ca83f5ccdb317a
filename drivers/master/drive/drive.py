"""One axis on the wire: its status as the TPDOs bring it, and the RPDOs that command it.

The drive remembers the controlword that it sent last, so that lowering bit 4 after a stop sends nothing and
never takes a halt back.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection

from drivers.bus.frame import Frame
from drivers.cia301.pdo import PdoLengthError
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, PowerState, holding_controlword
from drivers.master.ground.counters import NodeCounters
from drivers.master.ground.timing import Timing
from drivers.master.plan.pdo_plan import AxisPdos
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.status import Adoption, AxisStatus, Reference
from drivers.master.seen.watch import Watchdog

Condition = Callable[[AxisStatus], bool]
"""Looks at a status; may raise a `CanaxisError`, which then ends the waiting."""

Send = Callable[[Frame, bool], None]
"""Puts a frame on the bus, urgently or not; raises `BusError`."""


class Drive:
    """The status and the commands of one axis. It decides nothing."""

    def __init__(
        self,
        pdos: AxisPdos,
        send: Send,
        withdraw: Callable[[Collection[int]], None],
        timing: Timing,
        counters: NodeCounters,
        on_status: Callable[[AxisStatus], None],
        on_silence: Callable[[], None],
    ) -> None:
        """`withdraw` takes back what still waits with a COB-ID; `on_status` is told every new status,
        `on_silence` that a status TPDO is overdue.
        """
        self._pdos = pdos
        self._unpack_status = pdos.status.mapping.unpack
        self._unpack_motion = pdos.motion.mapping.unpack
        self._send = send
        self._withdraw = withdraw
        self._timing = timing
        self._counters = counters
        self._on_status = on_status
        self._silence = silence = timing.pdo_event_timer * timing.status_stale

        def overdue() -> None:
            self.note_stale()
            on_silence()

        self._status_watchdog = Watchdog(silence, timing.loop_grace, overdue)
        self._motion_watchdog = Watchdog(silence, timing.loop_grace, overdue)
        self._waiters: tuple[tuple[Condition, asyncio.Future[bool]], ...] = ()
        self.status = AxisStatus()
        self.status_at: float | None = None
        """Loop time at which the last TPDO 1 came."""
        self.motion_at: float | None = None
        """Loop time at which the last TPDO 2 came."""
        self.controlword: int | None = None
        """What was commanded last; None: nothing since the node's last boot-up."""
        self.commanded_mode: Mode | None = None
        self.target = 0
        """What was commanded last, steps or steps/s as the mode has it."""
        self.prepared = False
        """Whether something may wait in the module for the next SYNC."""

    # --- upwards ---

    def on_status_pdo(self, frame: Frame) -> None:
        """TPDO 1: statusword, mode, inputs."""
        try:
            statusword, mode, inputs = self._unpack_status(frame.data)
        except PdoLengthError:
            self._counters.short_pdos += 1
            return
        self._counters.pdos += 1
        self.status_at = now = frame.timestamp
        self._status_watchdog.feed(now)
        updated, stale = self._freshness(now)
        self._replace(self.status.with_status(statusword, mode, inputs, updated=updated, stale=stale))

    def on_motion_pdo(self, frame: Frame) -> None:
        """TPDO 2: position, velocity."""
        try:
            position, velocity = self._unpack_motion(frame.data)
        except PdoLengthError:
            self._counters.short_pdos += 1
            return
        self._counters.pdos += 1
        self.motion_at = now = frame.timestamp
        self._motion_watchdog.feed(now)
        updated, stale = self._freshness(now)
        self._replace(self.status.with_motion(position, velocity, updated=updated, stale=stale))

    def seed(self, statusword: int, mode: int, position: int, velocity: int) -> None:
        """What was read by SDO before PDOs flow; the status stays stale until they do.

        What was commanded before counts no more: somebody else may have commanded since.
        """
        self.controlword = self.commanded_mode = None
        self.status_at = self.motion_at = None
        seen = self.status.with_status(statusword, mode, 0, updated=self.status.updated, stale=True)
        self._replace(seen._replace(position=position, velocity=velocity))

    def note_reference(self, reference: Reference) -> None:
        """A homing began or was attained, or the reference is lost."""
        if reference is not self.status.reference:
            self._replace(self.status._replace(reference=reference))

    def note_adoption(self, adopted: Adoption | None) -> None:
        """The axis was found as `adopted` says, or (None) somebody claimed it."""
        if adopted != self.status.adopted:
            self._replace(self.status._replace(adopted=adopted))

    def note_emergencies(self, active: tuple[EmergencyRecord, ...]) -> None:
        """What is active on this axis now."""
        self._replace(self.status._replace(emergencies=active))

    def note_stale(self) -> None:
        """A status TPDO is overdue."""
        if not self.status.stale:
            self._replace(self.status._replace(stale=True))

    def distrust(self) -> None:
        """What the status TPDOs said does not count: believe the next ones only."""
        self.status_at = self.motion_at = None
        self.note_stale()

    def forget(self) -> None:
        """The module started anew: nothing that was commanded or seen holds any more."""
        self.unwatch()
        self.controlword = self.commanded_mode = None
        self.prepared = False
        """Whether a set point may wait in the module for a SYNC."""
        self.status_at = self.motion_at = None
        self._replace(AxisStatus(emergencies=self.status.emergencies, reference=self.status.reference))

    def unwatch(self) -> None:
        """Expect no status TPDO until one comes."""
        self._status_watchdog.stop()
        self._motion_watchdog.stop()

    async def until(
        self, condition: Condition, seconds: float, *, resend: Callable[[], None] | None = None
    ) -> bool:
        """Wait until a status meets `condition`; False if none does within `seconds`.

        `resend` is called each `Timing.resend` in between: only for what is idempotent.
        """
        loop = asyncio.get_running_loop()
        met: asyncio.Future[bool] = loop.create_future()
        waiter = (condition, met)
        self._waiters = (*self._waiters, waiter)
        try:
            if condition(self.status):
                return True
            patience = self._timing.resend if resend else seconds
            left = seconds  # counted down: a rest too small for the clock to see would be waited for for ever
            while left > 0:
                await asyncio.wait({met}, timeout=min(left, patience))
                if met.done():
                    return met.result()
                left -= patience
                if resend is not None and left > 0:
                    resend()
            return False
        finally:
            self._waiters = tuple(other for other in self._waiters if other is not waiter)
            if met.done():
                met.exception()  # retrieved, should the waiting task have been cancelled at the same moment

    async def fresh_motion(self) -> bool:
        """Wait for a position and velocity sampled from now on; False if none comes."""
        since = self._landed()
        return await self.until(lambda _: _is_after(self.motion_at, since), self._patience)

    async def fresh_status(self) -> bool:
        """Wait for both status TPDOs sampled from now on, all commands under way included; False if they
        don't come.
        """
        since = self._landed()
        return await self.until(
            lambda _: _is_after(self.motion_at, since) and _is_after(self.status_at, since), self._patience
        )

    @property
    def heard_at(self) -> float | None:
        """Loop time of the last status TPDO of either kind; None: none since the node's last boot-up."""
        return max((at for at in (self.status_at, self.motion_at) if at is not None), default=None)

    # --- downwards ---

    @property
    def mode(self) -> Mode:
        """The mode that counts now: the commanded one, else the one that the drive shows."""
        return self.status.mode if self.commanded_mode is None else self.commanded_mode

    @property
    def energised(self) -> bool:
        """Whether the drive holds its motor, as far as is known: only then may 0Fh be sent to it as a halt.

        What was commanded counts beside what was seen, which may be older: a drive that was told to leave
        OPERATION_ENABLED must not be brought back to it.
        """
        match self.status.state:
            case PowerState.OPERATION_ENABLED:
                return self.controlword is None or self._enable_commanded
            case None:
                return self._enable_commanded
            case _:
                return False

    @property
    def being_enabled(self) -> bool:
        """Whether OPERATION_ENABLED was commanded and not yet seen."""
        ready = (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON)
        return self._enable_commanded and self.status.state in ready

    @property
    def halted(self) -> bool:
        """Whether a halt was commanded last, and not taken back."""
        return self.energised and self.controlword is not None and bool(self.controlword & Controlword.HALT)

    @property
    def holding(self) -> int:
        """The controlword that keeps the drive in the state that it shows."""
        state = self.status.state
        return Controlword.DISABLE_VOLTAGE if state is None else holding_controlword(state)

    def command(self, controlword: int, mode: Mode, *, urgent: bool = False) -> None:
        """RPDO 1."""
        self.controlword, self.commanded_mode = controlword, mode
        pdo = self._pdos.power
        self._send(Frame(pdo.cob_id, pdo.mapping.pack((controlword, mode))), urgent)

    def command_position(self, controlword: int, target: int) -> None:
        """RPDO 2; `target` in steps."""
        self.controlword, self.target = controlword, target
        pdo = self._pdos.position
        self._send(Frame(pdo.cob_id, pdo.mapping.pack((controlword, target))), False)

    def prepare_position(self, controlword: int, target: int) -> None:
        """RPDO 4: as RPDO 2, but the module takes it with the next SYNC, whoever sends that.

        Until then it waits in the module: what is not to happen any more must be prepared over.
        """
        self.controlword, self.target = controlword, target
        self.prepared = True
        self._send_synchronous(controlword, target)

    def note_prepared(self) -> None:
        """Somebody else sent set points that wait for a SYNC."""
        self.prepared = True

    def note_taken(self) -> None:
        """What was prepared is seen to have been taken: nothing waits in the module any more."""
        self.prepared = False

    def prepare_over(self) -> None:
        """Put what was commanded last, without a set point and with the position that the axis has, over what
        may wait in the module for a SYNC.
        """
        word = self.holding if self.controlword is None else self.controlword
        if self.mode is not Mode.HOMING:  # there the bit is a level that a homing needs
            word &= ~Controlword.NEW_SET_POINT
        position = self.status.position  # in csp a target counts without an edge
        self._send_synchronous(word, self.target if position is None else position)

    def command_velocity(self, controlword: int, velocity: int, *, urgent: bool = False) -> None:
        """RPDO 3; `velocity` in steps/s."""
        self.controlword, self.target = controlword, velocity
        pdo = self._pdos.velocity
        self._withdraw((pdo.cob_id,))  # only the last velocity counts
        self._send(Frame(pdo.cob_id, pdo.mapping.pack((controlword, velocity))), urgent)

    def discard_waiting(self) -> None:
        """Take back every command that the bus did not take yet: a stop is to have the last word."""
        pdos = self._pdos
        self._withdraw(tuple(p.cob_id for p in (pdos.power, pdos.position, pdos.velocity, pdos.synchronous)))

    def lower_set_point(self) -> None:
        """Take bit 4 back after a set point; sends nothing if it is low already."""
        if self.controlword is not None and self.controlword & Controlword.NEW_SET_POINT:
            self.command_position(self.controlword & ~Controlword.NEW_SET_POINT, self.target)

    def halt(self, *, urgent: bool = True) -> None:
        """Begin the ramp down to standstill, as the mode has it; stays OPERATION_ENABLED. Idempotent.

        Never sent to a drive that is not energised: 0Fh would enable it.
        """
        if urgent:
            self.discard_waiting()
        enabled = Controlword.ENABLE_OPERATION
        match self.mode:
            case Mode.HOMING:  # knows no halt bit: bit 4 = 0 stops (manual §8.2.1)
                self.command(enabled, Mode.HOMING, urgent=urgent)
            case Mode.PROFILE_VELOCITY | Mode.CYCLIC_SYNC_VELOCITY:
                self.command_velocity(enabled | Controlword.HALT, 0, urgent=urgent)
            case mode:
                self.command(enabled | Controlword.HALT, mode, urgent=urgent)

    # --- inside ---

    def _send_synchronous(self, controlword: int, target: int) -> None:
        pdo = self._pdos.synchronous
        self._send(Frame(pdo.cob_id, pdo.mapping.pack((controlword, target))), False)

    @property
    def _enable_commanded(self) -> bool:
        return self.controlword is not None and self.controlword & 0x8F == Controlword.ENABLE_OPERATION

    @property
    def _patience(self) -> float:
        """How long a status TPDO may take that is sent again at each event timer tick."""
        return 1.5 * self._timing.pdo_event_timer + self._timing.flight

    def _landed(self) -> float:
        """When everything that is under way now has arrived."""
        return asyncio.get_running_loop().time() + self._timing.flight

    def _freshness(self, now: float) -> tuple[float, bool]:
        """`AxisStatus.updated` and `stale`."""
        status_at, motion_at = self.status_at, self.motion_at
        if status_at is None or motion_at is None:
            return self.status.updated, self.status.stale
        oldest = status_at if status_at < motion_at else motion_at
        return oldest, now - oldest > self._silence

    def _replace(self, status: AxisStatus) -> None:
        self.status = status
        for condition, met in self._waiters:
            if not met.done():
                try:
                    if condition(status):
                        met.set_result(True)
                except Exception as error:
                    met.set_exception(error)
        self._on_status(status)


def _is_after(heard: float | None, since: float) -> bool:
    return heard is not None and heard > since
