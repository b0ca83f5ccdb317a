"""Snapshots of an axis, a node and the bus: frozen, each with one writer."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

from drivers.bus.base import BusState
from drivers.cia301.nmt import NmtState
from drivers.cia402.modes import Mode
from drivers.cia402.objects import DigitalInput
from drivers.cia402.power import PowerState, Statusword, decode_state
from drivers.master.ground.counters import NetworkCounters, NodeCounters
from drivers.master.seen.boot_log import BootStep
from drivers.master.seen.emergencies import EmergencyRecord

SWITCHED_OFF = frozenset(
    {
        PowerState.SWITCH_ON_DISABLED,
        PowerState.READY_TO_SWITCH_ON,
        PowerState.NOT_READY_TO_SWITCH_ON,
        PowerState.FAULT,
    }
)
"""States in which the drive holds no torque."""


@dataclass(frozen=True, slots=True)
class Switches:
    """The switches of an axis as 60FDh shows them (bits 0, 1 and 2 of CiA 402; unverified on hardware)."""

    negative_limit: bool = False
    positive_limit: bool = False
    home: bool = False


class Reference(enum.StrEnum):
    """Whether positions are counted from home."""

    UNKNOWN = "unknown"
    """Not homed since this service has the module in view without a break."""
    HOMED = "homed"
    """A homing was attained, and the module has not started anew since."""
    LOST = "lost"
    """The module started anew by itself, or another homing was begun and not attained."""


class AxisStatus(NamedTuple):
    """What an axis's TPDOs said last. `updated` and `stale` tell how far to trust it.

    A tuple rather than a dataclass, because one is made for every status TPDO of a full bus.
    """

    state: PowerState | None = None
    """None until the first statusword, or where the statusword names no state."""
    mode: Mode = Mode.NO_MODE
    """6061h"""
    statusword: int = 0
    """6041h"""
    position: int | None = None
    """6064h, steps"""
    velocity: int | None = None
    """606Ch, steps/s"""
    target_reached: bool = False
    """Statusword bit 10."""
    moving: bool = False
    """Statusword bit 14."""
    reference: Reference = Reference.UNKNOWN
    switches: Switches = Switches()
    emergencies: tuple[EmergencyRecord, ...] = ()
    """The active ones of this axis and of the whole module."""
    updated: float = -math.inf
    """Loop time at which the older of the two status TPDOs came; -inf: never."""
    stale: bool = True
    """Whether a status TPDO is overdue, so that all the rest may be wrong."""
    adopted: Adoption | None = None
    """How the axis was found, until somebody claims it by enabling it; None: it was found switched off."""

    @property
    def referenced(self) -> bool:
        """Whether a homing was attained since the module's last reset."""
        return self.reference is Reference.HOMED

    def with_status(
        self, statusword: int, mode: int, inputs: int, *, updated: float, stale: bool
    ) -> AxisStatus:
        """This status with what a TPDO 1 carries: 6041h, 6061h and 60FDh."""
        state, target_reached, moving = _meaning(statusword)
        return AxisStatus(
            state,
            _MODES.get(mode, Mode.NO_MODE),
            statusword,
            self.position,
            self.velocity,
            target_reached,
            moving,
            self.reference,
            _SWITCHES[inputs & _ALL_SWITCHES],
            self.emergencies,
            updated,
            stale,
            self.adopted,
        )

    def with_motion(self, position: int, velocity: int, *, updated: float, stale: bool) -> AxisStatus:
        """This status with what a TPDO 2 carries: 6064h and 606Ch."""
        state, mode, statusword, _, _, reached, moving, reference, switches, emergencies, _, _, adopted = self
        return AxisStatus(
            state,
            mode,
            statusword,
            position,
            velocity,
            reached,
            moving,
            reference,
            switches,
            emergencies,
            updated,
            stale,
            adopted,
        )


@dataclass(frozen=True, slots=True)
class Adoption:
    """How an axis was found that nobody here has enabled: read by SDO before anything was written to it."""

    reason: str
    """Why it has to be claimed, as a sentence."""
    state: PowerState | None
    """6041h; None where the statusword names no state."""
    mode: Mode
    """6061h"""
    moving: bool
    """Statusword bit 14."""
    position: int | None
    """6064h, steps"""
    velocity: int | None
    """606Ch, steps/s"""

    @classmethod
    def of(cls, found: AxisStatus, reason: str) -> Adoption:
        """What a status says."""
        return cls(reason, found.state, found.mode, found.moving, found.position, found.velocity)


_MODES: Final = {mode.value: mode for mode in Mode}
_ALL_SWITCHES: Final = DigitalInput.NEGATIVE_LIMIT | DigitalInput.POSITIVE_LIMIT | DigitalInput.HOME_SWITCH
_SWITCHES: Final = tuple(
    Switches(
        negative_limit=bool(inputs & DigitalInput.NEGATIVE_LIMIT),
        positive_limit=bool(inputs & DigitalInput.POSITIVE_LIMIT),
        home=bool(inputs & DigitalInput.HOME_SWITCH),
    )
    for inputs in range(_ALL_SWITCHES + 1)
)
"""By the bits of 60FDh."""


@lru_cache(maxsize=1024)
def _meaning(statusword: int) -> tuple[PowerState | None, bool, bool]:
    """The state, whether the target is reached, whether the motor turns; an axis shows few words."""
    return (
        decode_state(statusword),
        bool(statusword & Statusword.TARGET_REACHED),
        bool(statusword & Statusword.MOTOR_ACTIVITY),
    )


class NodeState(enum.StrEnum):
    """How far a node is on its way to being used."""

    ABSENT = "absent"
    """Never answered."""
    BOOTED = "booted"
    """Answered or booted; not yet known."""
    IDENTIFIED = "identified"
    """Is what the configuration says; being configured."""
    CONFIGURED = "configured"
    """Holds what it must, read back; being started."""
    OPERATIONAL = "operational"
    """NMT Operational; its axes may be commanded."""
    LOST = "lost"
    """Was there; silent now. Whether its motors turn is unknown."""
    REFUSED = "refused"
    """Is something else, or doesn't hold what it must; nothing is written to it."""
    DUPLICATE = "duplicate"
    """Two nodes have this ID; motion is blocked and nothing is written."""


SETTLED = frozenset({NodeState.CONFIGURED, NodeState.OPERATIONAL})
"""The node holds what it must; whatever it does against that is news."""


class Failsafe(enum.StrEnum):
    """Whether the module stops its motors when our heartbeat ends."""

    VERIFIED = "verified"
    """Seen to happen on this module since its last boot-up."""
    UNVERIFIED = "unverified"
    """1029h:1 reads as it should, and 1016h too; whether the firmware follows was not tried."""
    OFF = "off"
    """The module would not take 1029h:1."""


@dataclass(frozen=True, slots=True)
class Identity:
    """1000h and 1018h."""

    device_type: int
    vendor_id: int
    product_code: int
    revision: int | None = None
    serial: int | None = None


@dataclass(frozen=True, slots=True)
class Particulars:
    """What a node says of itself."""

    identity: Identity
    device_name: str
    hardware_version: str
    software_version: str


@dataclass(frozen=True, slots=True)
class NodeStatus:
    """One node at one moment."""

    state: NodeState
    reason: str
    """Why it is in this state, as a sentence; empty when all is well."""
    nmt_state: NmtState | None
    """As its last heartbeat or its status PDOs said; None: never heard, or lost."""
    identity: Identity | None
    device_name: str
    hardware_version: str
    software_version: str
    serial: int | None
    failsafe: Failsafe
    heartbeat_age_s: float | None
    """Seconds since its last heartbeat; None: never heard."""
    emergencies: tuple[EmergencyRecord, ...]
    """The active ones, of all axes and the module."""
    boot: tuple[BootStep, ...]
    """What became of each step of its last boot-up."""
    counters: NodeCounters


@dataclass(frozen=True, slots=True)
class BusStatus:
    """The wire at one moment."""

    name: str
    state: BusState
    reason: str
    """Why it is in this state; empty when all is well."""
    warnings: tuple[str, ...]
    """Sentences on what is odd on the bus, e.g. a node under a borrowed ID."""
    counters: NetworkCounters
