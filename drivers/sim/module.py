"""`SimulatedModule`: the whole module, sans-IO. Frames and the time in, frames and the next wake-up out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from drivers.bus.frame import Frame
from drivers.cia301 import cob, nmt, sync
from drivers.cia301.emcy import Emergency
from drivers.cia301.lss import Identity
from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.objects import Address
from drivers.cia301.pdo import Direction
from drivers.cia301.sdo import SdoServer
from drivers.cia301.types import Value
from drivers.devices.emergencies import Severity
from drivers.devices.profile import DeviceProfile
from drivers.sim.addressing import Addressing
from drivers.sim.communication import APPLICATION_ERROR, COMMUNICATION_ERROR, Communication
from drivers.sim.dictionary import AxisView, ObjectDictionary, defaults
from drivers.sim.emergency import EmergencyProducer
from drivers.sim.guarding import ErrorBehavior, HeartbeatConsumer, Reaction
from drivers.sim.interface import AxisParameters, RaiseEmergency
from drivers.sim.motion.axis import SimulatedAxis
from drivers.sim.motion.travel import AxisSettings
from drivers.sim.parameters import NODE_ID, ParameterMemory
from drivers.sim.pdo_records import PdoRecord, PdoRecords
from drivers.sim.receive import ReceivePdos
from drivers.sim.storage import MemoryStore, Store
from drivers.sim.terminals import Terminals
from drivers.sim.transmit import TransmitPdos

BuildAxis = Callable[[int, AxisParameters, AxisSettings, RaiseEmergency], SimulatedAxis]

HEARTBEAT_LOST: Final = 0x8130
BUS_OFF_RECOVERED: Final = 0x8140

HARDWARE_VERSION: Final = "1.00"
SOFTWARE_VERSION: Final = "1.04"

_NEXT_STATE: Final = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}

_COMMUNICATION_AREA: Final = range(0x1000, 0x2000)


class SimulatedModule:
    """A TMCM-3216 on the wire. `now` is seconds on a monotonic clock and never goes back.

    Each method that takes `now` and returns frames returns all that the module sends by then, in order. Until
    `next_wakeup` it has nothing to say by itself; an idle module has no wake-up at all.
    """

    def __init__(
        self,
        profile: DeviceProfile,
        node_id: int = 1,
        *,
        axes: Sequence[AxisSettings] | None = None,
        store: Store | None = None,
        serial: int = 1,
        error_behavior: ErrorBehavior = ErrorBehavior.MANUAL,
        build_axis: BuildAxis = SimulatedAxis,
    ) -> None:
        """Make a module without supply; `power_on` starts it.

        `node_id` (1..127, or 255 = unconfigured) holds until another one is saved in `store`. `axes` are the
        settings of the first axes, defaults for the others. ValueError for a bad node ID or too many axes.
        """
        self.profile = profile
        self._identity = Identity(
            profile.vendor_id, profile.product_code, profile.identity.revision_number, serial
        )
        self._now = 0.0
        self._powered = False
        self._state = NmtState.BOOT_UP
        self._reaction = Reaction.REMAIN
        self._outbox: list[Frame] = []

        self.dictionary = ObjectDictionary(profile)
        self.dictionary.load(defaults(profile, node_id))
        self.terminals = Terminals(self.dictionary)
        self._memory = ParameterMemory(self.dictionary, store if store is not None else MemoryStore())
        self._addressing = Addressing(self.dictionary, self._memory, self._identity, node_id)
        self._emergencies = EmergencyProducer(profile.axes)
        self._communication = Communication(self.dictionary, self._emergencies, error_behavior)
        self._records = PdoRecords(self.dictionary, self._on_record_changed)
        self._receive = ReceivePdos(self.dictionary, self._emergencies.passing)
        self._transmit = TransmitPdos(self.dictionary, lambda: self.axes)
        self._sdo = SdoServer(
            lambda address: self.dictionary.read(address, self._now),
            lambda address, data: self.dictionary.write(address, data, self._now),
            self.dictionary.size_of,
        )
        given = tuple(axes or ())
        if len(given) > profile.axes:
            raise ValueError(f"{profile.model} has {profile.axes} axes, but {len(given)} have settings")
        settings = (*given, *(AxisSettings() for _ in range(profile.axes - len(given))))
        self.axes: tuple[SimulatedAxis, ...] = tuple(
            build_axis(number, AxisView(self.dictionary, number), own, self._emergencies_of(number))
            for number, own in zip(range(profile.axes), settings, strict=True)
        )
        self.dictionary.attach_axes(self.axes)

    # --- what can be seen from outside ----------------------------------------------------------------------

    @property
    def powered(self) -> bool:
        """Whether the module has its supply."""
        return self._powered

    @property
    def nmt_state(self) -> NmtState:
        """`BOOT_UP` while it has no supply or no node ID."""
        return self._state

    @property
    def node_id(self) -> int | None:
        """The node ID in force; None = unconfigured."""
        return self._addressing.node_id

    @property
    def watch(self) -> HeartbeatConsumer:
        """The watch over the master's heartbeat (1016h:1); for looking only."""
        return self._communication.consumer

    @property
    def bit_rate(self) -> int:
        """The bit rate in force, kbit/s."""
        return self._addressing.bit_rate

    @property
    def error_register(self) -> int:
        """1001h."""
        return self._emergencies.register

    # --- supply ---------------------------------------------------------------------------------------------

    def power_on(self, now: float) -> list[Frame]:
        """Give it its supply. A module that has it already is power-cycled."""
        if self._powered:
            self.power_off(now)
        self._powered = True
        self._reset_node(now)
        return self._settle(now)

    def power_off(self, now: float) -> None:
        """Take its supply away: everything that is not saved is gone."""
        self._powered = False
        self._now = now
        self._leave_operational()
        self._state = NmtState.BOOT_UP
        self._outbox.clear()
        for axis in self.axes:
            axis.power_off(now)

    # --- time and frames ------------------------------------------------------------------------------------

    def hears(self, frame: Frame) -> bool:
        """Whether `on_frame` would do anything with the frame now."""
        return self._handler(frame) is not None

    def on_frame(self, frame: Frame, now: float) -> list[Frame]:
        """A frame on the wire, of another node."""
        handler = self._handler(frame)
        if handler is None:
            return []
        self._advance(now)
        handler(frame)
        return self._settle(now)

    def on_time(self, now: float) -> list[Frame]:
        """The wake-up came, or something was changed from outside (a switch, an input)."""
        return self._settle(now) if self._powered else []

    def next_wakeup(self, now: float) -> float | None:
        """When to call `on_time` if no frame comes before; None = not at all."""
        if not self._powered:
            return None
        times = [
            self._communication.producer.next_wakeup,
            self._communication.consumer.next_wakeup,
            self._emergencies.next_wakeup(),
            self._transmit.next_wakeup(),
            # As of what was settled last: an event that came due since then must run in `on_time`, which
            # also sends what follows from it.
            *(axis.next_event(self._now) for axis in self.axes),
        ]
        return min((max(time, now) for time in times if time is not None), default=None)

    def shutdown_switch(self, active: bool, now: float) -> None:
        """Take the module's enable signal away, or give it back (EMCY 5441h). Call `on_time` afterwards."""
        for axis in self.axes:
            axis.shutdown_input(active, now)

    # --- what the CAN controller reports --------------------------------------------------------------------

    def report(self, code: int, detail: int, now: float) -> list[Frame]:
        """Have it send a module-wide EMCY for an error that is over at once (8100h, 8110h, 8120h, ...)."""
        if not self._powered:
            return []
        self._emergencies.passing(code, detail)
        return self._settle(now)

    def bus_off(self, now: float) -> None:
        """Its controller went bus-off: every enabled axis is stopped and disabled (manual §11.2, 8140h)."""
        if self._powered:
            self._now = now
            for axis in self.axes:
                axis.nmt_stopped(now)

    def bus_on(self, now: float) -> list[Frame]:
        """Its controller recovered from bus-off: EMCY 8140h, then what 1029h:1 asks for."""
        if not self._powered:
            return []
        self._emergencies.passing(BUS_OFF_RECOVERED)
        self._react(self._communication.reaction(COMMUNICATION_ERROR))
        return self._settle(now)

    # --- frames, one by one ---------------------------------------------------------------------------------

    def _handler(self, frame: Frame) -> Callable[[Frame], None] | None:
        cob_id = frame.cob_id
        if not self._powered or frame.error or frame.remote or frame.extended:
            return None
        if cob_id == cob.LSS_REQUEST:
            return self._on_lss
        node = self.node_id
        if node is None:
            return None
        if cob_id == cob.NMT:
            return self._on_nmt
        watched = self._communication.consumer.node
        if watched is not None and cob_id == cob.HEARTBEAT + watched:
            return self._on_heartbeat
        if self._state is NmtState.STOPPED:
            return None
        if cob_id == cob.SDO_REQUEST + node:
            return self._on_sdo
        if cob_id == self._communication.sync_cob_id:
            return self._on_sync
        return self._on_pdo if self._receive.listens(cob_id) else None

    def _on_lss(self, frame: Frame) -> None:
        answers, boots = self._addressing.feed(frame.data)
        self._outbox.extend(Frame(cob.LSS_RESPONSE, answer) for answer in answers)
        if boots:
            self._reset_communication(self._now)

    def _on_nmt(self, frame: Frame) -> None:
        command = nmt.decode(frame.data)
        if command is None or command[1] not in (nmt.ALL_NODES, self.node_id):
            return
        if command[0] is NmtCommand.RESET_NODE:
            self._reset_node(self._now)
        elif command[0] is NmtCommand.RESET_COMMUNICATION:
            self._addressing.reset_communication()
            self._reset_communication(self._now)
        else:
            self._enter(_NEXT_STATE[command[0]])

    def _on_heartbeat(self, frame: Frame) -> None:
        if len(frame.data) == 1 and self._communication.consumer.heard(self._now):
            self._emergencies.recovered()

    def _on_sdo(self, frame: Frame) -> None:
        node, answer = self.node_id, self._sdo.feed(frame.data)
        if answer is not None and node is not None:
            self._outbox.append(Frame(cob.SDO_RESPONSE + node, answer))

    def _on_sync(self, frame: Frame) -> None:
        if sync.decode(frame.data) is None:
            return
        self._outbox.extend(self._transmit.sync(self._now))
        self._receive.sync(self._now)
        for axis in self.axes:
            axis.sync(self._now)

    def _on_pdo(self, frame: Frame) -> None:
        self._receive.receive(frame.cob_id, frame.data, self._now)

    # --- NMT ------------------------------------------------------------------------------------------------

    def _reset_node(self, now: float) -> None:
        self._now = now
        self._leave_operational()
        self._addressing.reset_node()
        self.dictionary.load(self._reset_values(self.profile.objects))
        self.dictionary.load(self._memory.saved())
        self._emergencies.reset()
        for axis in self.axes:
            axis.reset(now)
        self._boot(now)

    def _reset_communication(self, now: float) -> None:
        self._leave_operational()
        area = (address for address in self.profile.objects if address.index in _COMMUNICATION_AREA)
        self.dictionary.load(self._reset_values(area))
        self._emergencies.forget()
        self._boot(now)

    def _reset_values(self, addresses: Iterable[Address]) -> dict[Address, Value]:
        node = self.node_id
        values = defaults(self.profile, 0 if node is None else node)
        vendor, product, revision, serial = self._identity
        values |= {
            Address(0x1009): HARDWARE_VERSION,
            Address(0x100A): SOFTWARE_VERSION,
            Address(0x1018, 1): vendor,
            Address(0x1018, 2): product,
            Address(0x1018, 3): revision,
            Address(0x1018, 4): serial,
            NODE_ID: self._addressing.saved_node_id,
        }
        return {address: values[address] for address in addresses}

    def _boot(self, now: float) -> None:
        self._sdo.reset()
        self._reaction = Reaction.REMAIN
        self._communication.reset(now)
        node = self.node_id
        if node is None:
            self._state = NmtState.BOOT_UP
        else:
            self._state = NmtState.PRE_OPERATIONAL
            self._outbox.append(Frame(cob.HEARTBEAT + node, bytes((NmtState.BOOT_UP,))))

    def _enter(self, state: NmtState) -> None:
        if state is self._state:
            return
        self._leave_operational()
        self._state = state
        if state is NmtState.OPERATIONAL:
            self._receive.start(self._records)
            self._transmit.start(self._records)
        elif state is NmtState.STOPPED:
            self._sdo.reset()
            for axis in self.axes:
                axis.nmt_stopped(self._now)
            self._emergencies.silence()

    def _leave_operational(self) -> None:
        self._receive.stop()
        self._transmit.stop()

    # --- errors ---------------------------------------------------------------------------------------------

    def _emergencies_of(self, axis: int) -> RaiseEmergency:
        def raise_emergency(emergency: Emergency) -> None:
            self._emergencies.from_axis(axis, emergency)
            if self.profile.emergencies.explain(emergency).severity is Severity.FAULT:
                self._react(self._communication.reaction(APPLICATION_ERROR))

        return raise_emergency

    def _react(self, reaction: Reaction) -> None:
        """Remember what 1029h asks for until the EMCY is out. It acts in Operational only (§3.1.14)."""
        if self._state is NmtState.OPERATIONAL and reaction is not Reaction.REMAIN:
            self._reaction = reaction

    def _on_record_changed(self, record: PdoRecord) -> None:
        pdos = self._transmit if record.direction is Direction.TRANSMIT else self._receive
        pdos.configure(self._records, record)

    # --- the end of every call ------------------------------------------------------------------------------

    def _advance(self, now: float) -> None:
        self._now = now
        for axis in self.axes:
            axis.advance(now)

    def _settle(self, now: float) -> list[Frame]:
        """Bring everything up to `now` and give all that there is to send."""
        self._advance(now)
        if self._communication.consumer.poll(now):
            self._emergencies.lasting(HEARTBEAT_LOST)
            self._react(self._communication.reaction(COMMUNICATION_ERROR))
        node = self.node_id
        if node is None or self._state is NmtState.STOPPED:
            self._emergencies.silence()
        self._outbox.extend(self._emergencies.poll(now))
        if self._reaction is not Reaction.REMAIN:
            stops = self._reaction is Reaction.STOP
            self._reaction = Reaction.REMAIN
            self._enter(NmtState.STOPPED if stops else NmtState.PRE_OPERATIONAL)
        if node is not None and self._communication.producer.poll(now):
            self._outbox.append(Frame(cob.HEARTBEAT + node, bytes((self._state,))))
        self._outbox.extend(self._transmit.poll(now))
        frames, self._outbox = self._outbox, []
        return frames
