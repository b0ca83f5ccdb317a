"""What can go wrong with one axis: its EMCY (manual §11.2), its bit in 1001h, and what the drive does."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from drivers.cia301.emcy import Emergency
from drivers.sim.motion.travel import AxisSettings

Bridge = Literal["a", "b", "high"]
MODULE: Final = 255
"""Byte #2 of an emergency that concerns the module, not one axis."""


class Severity(enum.Enum):
    """What a trouble does."""

    WARNING = enum.auto()
    """An EMCY and the warning bit; the axis goes on."""
    RAMP = enum.auto()
    """Ramp down with 6085h, then FAULT (605Eh = 2)."""
    CUT = enum.auto()
    """The driver is off: the motor stands at once, and FAULT."""


class Register:
    """Bits of 1001h (manual §3.1.2)."""

    GENERIC: Final = 1 << 0
    CURRENT: Final = 1 << 1
    VOLTAGE: Final = 1 << 2
    TEMPERATURE: Final = 1 << 3
    PROFILE: Final = 1 << 5
    MANUFACTURER: Final = 1 << 7


@dataclass(frozen=True, slots=True)
class TroubleRow:
    """A row of the EMCY table. Its bit of 1001h goes by the class of the code: unverified on hardware."""

    code: int
    cause: int
    """Additional byte #1."""
    register: int
    severity: Severity


class Trouble(enum.Enum):
    """Every trouble of an axis. Byte #1 of 4310h is unverified on hardware."""

    OPEN_LOAD_A = TroubleRow(0x1000, 1, Register.GENERIC, Severity.WARNING)
    OPEN_LOAD_B = TroubleRow(0x1000, 2, Register.GENERIC, Severity.WARNING)
    OVERCURRENT_HIGH_SIDE = TroubleRow(0x2310, 0, Register.CURRENT, Severity.CUT)
    OVERCURRENT_B = TroubleRow(0x2311, 0, Register.CURRENT, Severity.CUT)
    OVERCURRENT_A = TroubleRow(0x2312, 0, Register.CURRENT, Severity.CUT)
    STALL = TroubleRow(0x3230, 0, Register.VOLTAGE, Severity.CUT)
    TEMPERATURE_WARNING = TroubleRow(0x4310, 1, Register.TEMPERATURE, Severity.WARNING)
    OVERTEMPERATURE = TroubleRow(0x4310, 2, Register.TEMPERATURE, Severity.CUT)
    SHUTDOWN_SWITCH = TroubleRow(0x5441, 0, Register.GENERIC, Severity.CUT)
    FOLLOWING_ERROR = TroubleRow(0x8611, 0, Register.PROFILE, Severity.RAMP)
    UNDERVOLTAGE = TroubleRow(0xFF00, 0, Register.MANUFACTURER, Severity.CUT)
    POSITIVE_SOFTWARE_LIMIT = TroubleRow(0xFF01, 1, Register.MANUFACTURER, Severity.RAMP)
    NEGATIVE_SOFTWARE_LIMIT = TroubleRow(0xFF01, 2, Register.MANUFACTURER, Severity.RAMP)
    POSITIVE_LIMIT_SWITCH = TroubleRow(0xFF01, 3, Register.MANUFACTURER, Severity.CUT)
    NEGATIVE_LIMIT_SWITCH = TroubleRow(0xFF01, 4, Register.MANUFACTURER, Severity.CUT)

    def emergency(self, axis: int, register: int) -> Emergency:
        """The message, with what 1001h holds now for the axis."""
        where = MODULE if self is Trouble.SHUTDOWN_SWITCH else axis
        return Emergency(self.value.code, register, bytes((self.value.cause, where, 0, 0, 0)))


def fault_reset(axis: int) -> Emergency:
    """The message that a fault reset was executed."""
    return Emergency(0, 0, bytes((0, axis, 0, 0, 0)))


def register_of(troubles: frozenset[Trouble]) -> int:
    """The bits of 1001h that some troubles keep set; bit 0 goes with each."""
    register = Register.GENERIC if troubles else 0
    for trouble in troubles:
        register |= trouble.value.register
    return register


class Conditions:
    """The electrical state of an axis. The thresholds are unverified on hardware."""

    UNDERVOLTAGE: Final = 10.0
    """Volts."""
    WARM: Final = 120.0
    """Pre-warning, degrees Celsius."""
    HOT: Final = 150.0
    """Switched off, degrees Celsius."""

    def __init__(self, settings: AxisSettings) -> None:
        self.voltage = settings.supply_voltage
        self.temperature = settings.temperature
        self.shorts: set[Bridge] = set()
        self.open_loads: set[Bridge] = set()
        self.shutdown = False

    def present(self) -> frozenset[Trouble]:
        """The troubles whose causes are there now."""
        return frozenset(self._present())

    def _present(self) -> Iterator[Trouble]:
        if "a" in self.open_loads:
            yield Trouble.OPEN_LOAD_A
        if "b" in self.open_loads:
            yield Trouble.OPEN_LOAD_B
        if "high" in self.shorts:
            yield Trouble.OVERCURRENT_HIGH_SIDE
        if "b" in self.shorts:
            yield Trouble.OVERCURRENT_B
        if "a" in self.shorts:
            yield Trouble.OVERCURRENT_A
        if self.temperature >= self.WARM:
            yield Trouble.TEMPERATURE_WARNING
        if self.temperature >= self.HOT:
            yield Trouble.OVERTEMPERATURE
        if self.shutdown:
            yield Trouble.SHUTDOWN_SWITCH
        if self.voltage < self.UNDERVOLTAGE:
            yield Trouble.UNDERVOLTAGE

    def driver_flags(self) -> int:
        """2102h (manual §4.2.55)."""
        present = self.present()
        return sum(bit for trouble, bit in _FLAGS.items() if trouble in present)


_FLAGS: Final = {
    Trouble.OVERCURRENT_A: 1 << 0,
    Trouble.OVERCURRENT_B: 1 << 1,
    Trouble.OPEN_LOAD_A: 1 << 2,
    Trouble.OPEN_LOAD_B: 1 << 3,
    Trouble.OVERCURRENT_HIGH_SIDE: 1 << 4,
    Trouble.UNDERVOLTAGE: 1 << 5,
    Trouble.TEMPERATURE_WARNING: 1 << 6,
    Trouble.OVERTEMPERATURE: 1 << 7,
}
