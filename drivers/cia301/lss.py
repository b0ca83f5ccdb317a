"""Layer setting services: the master's requests, a slave's answers, the bit rates (CiA 305, manual §2.3).

All frames are eight bytes, requests on COB-ID 7E5h, answers on 7E4h. The slave is in `lss_slave`.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

UNCONFIGURED: Final = 0xFF
"""The node-ID of a node that has none."""

STANDARD_TABLE: Final = 0
"""The bit timing table of CiA 301, the only one that is used."""

BIT_RATES: Final[Mapping[int, int]] = MappingProxyType(
    {0: 1000, 1: 800, 2: 500, 3: 250, 4: 125, 6: 50, 7: 20, 8: 10}
)
"""Table index to kbit/s. Index 5 is reserved."""
BIT_RATE_INDEX: Final[Mapping[int, int]] = MappingProxyType(
    {rate: index for index, rate in BIT_RATES.items()}
)
"""kbit/s to table index."""


class Command(enum.IntEnum):
    """Command specifiers, byte 0."""

    SWITCH_GLOBAL = 0x04
    CONFIGURE_NODE_ID = 0x11
    CONFIGURE_BIT_TIMING = 0x13
    ACTIVATE_BIT_TIMING = 0x15
    STORE = 0x17
    SELECT_VENDOR = 0x40
    SELECT_PRODUCT = 0x41
    SELECT_REVISION = 0x42
    SELECT_SERIAL = 0x43
    SELECTED = 0x44
    IDENTIFY_VENDOR = 0x46
    IDENTIFY_PRODUCT = 0x47
    IDENTIFY_REVISION_LOW = 0x48
    IDENTIFY_REVISION_HIGH = 0x49
    IDENTIFY_SERIAL_LOW = 0x4A
    IDENTIFY_SERIAL_HIGH = 0x4B
    IDENTIFY_NON_CONFIGURED = 0x4C
    IDENTIFIED = 0x4F
    NON_CONFIGURED = 0x50
    FASTSCAN = 0x51
    INQUIRE_VENDOR = 0x5A
    INQUIRE_PRODUCT = 0x5B
    INQUIRE_REVISION = 0x5C
    INQUIRE_SERIAL = 0x5D
    INQUIRE_NODE_ID = 0x5E


class Mode(enum.IntEnum):
    """The state of a slave."""

    WAITING = 0
    CONFIGURATION = 1


class Identity(NamedTuple):
    """The LSS address: the four values of 1018h, each 32 bits."""

    vendor: int
    product: int
    revision: int
    serial: int


class IdentityRange(NamedTuple):
    """Which nodes an identify request means; both ends are meant too."""

    vendor: int
    product: int
    revision_low: int
    revision_high: int
    serial_low: int
    serial_high: int


SELECT_COMMANDS: Final = (
    Command.SELECT_VENDOR,
    Command.SELECT_PRODUCT,
    Command.SELECT_REVISION,
    Command.SELECT_SERIAL,
)
IDENTIFY_COMMANDS: Final = (
    Command.IDENTIFY_VENDOR,
    Command.IDENTIFY_PRODUCT,
    Command.IDENTIFY_REVISION_LOW,
    Command.IDENTIFY_REVISION_HIGH,
    Command.IDENTIFY_SERIAL_LOW,
    Command.IDENTIFY_SERIAL_HIGH,
)
INQUIRE_COMMANDS: Final = (
    Command.INQUIRE_VENDOR,
    Command.INQUIRE_PRODUCT,
    Command.INQUIRE_REVISION,
    Command.INQUIRE_SERIAL,
)
_CONFIGURE_COMMANDS: Final = (
    Command.CONFIGURE_NODE_ID,
    Command.CONFIGURE_BIT_TIMING,
    Command.STORE,
)


def frame(command: Command, payload: bytes = b"") -> bytes:
    """A frame of either side: the specifier, the payload, zeros."""
    return (bytes((command,)) + payload).ljust(8, b"\0")


def _number(command: Command, value: int) -> bytes:
    return frame(command, value.to_bytes(4, "little"))


def switch_global(mode: Mode) -> bytes:
    """Put all slaves into a state. Not answered."""
    return frame(Command.SWITCH_GLOBAL, bytes((mode,)))


def switch_selective(identity: Identity) -> tuple[bytes, ...]:
    """The four requests that put one slave into configuration; it answers the last with `Selected`."""
    return tuple(_number(c, value) for c, value in zip(SELECT_COMMANDS, identity, strict=True))


def configure_node_id(node: int) -> bytes:
    """Set the node-ID, 1..127 or `UNCONFIGURED`; answered with `Configured`. ValueError otherwise."""
    if not (1 <= node <= 127 or node == UNCONFIGURED):
        raise ValueError(f"{node} is neither a node-ID nor {UNCONFIGURED} (unconfigured)")
    return frame(Command.CONFIGURE_NODE_ID, bytes((node,)))


def configure_bit_rate(kbit_s: int) -> bytes:
    """Set the bit rate for `activate_bit_rate`: `Configured` answers. ValueError if unknown."""
    if kbit_s not in BIT_RATE_INDEX:
        raise ValueError(f"{kbit_s} kbit/s is none of {sorted(BIT_RATE_INDEX)}")
    return frame(Command.CONFIGURE_BIT_TIMING, bytes((STANDARD_TABLE, BIT_RATE_INDEX[kbit_s])))


def activate_bit_rate(delay_ms: int) -> bytes:
    """Have all slaves in configuration be silent for `delay_ms`, switch, and be silent as long again."""
    return frame(Command.ACTIVATE_BIT_TIMING, delay_ms.to_bytes(2, "little"))


def store() -> bytes:
    """Keep node-ID and bit rate over a power cycle; answered with `Configured`."""
    return frame(Command.STORE)


def inquire(command: Command) -> bytes:
    """Ask the slave in configuration for a part of its identity, or its node-ID: `Inquired` answers."""
    if command not in INQUIRE_COMMANDS and command is not Command.INQUIRE_NODE_ID:
        raise ValueError(f"{command.name} inquires nothing")
    return frame(command)


def identify(span: IdentityRange) -> tuple[bytes, ...]:
    """The six requests to which every slave in the range answers `Identified`."""
    return tuple(_number(c, value) for c, value in zip(IDENTIFY_COMMANDS, span, strict=True))


def identify_non_configured() -> bytes:
    """Ask whether any slave has no node-ID; each answers `NonConfigured`."""
    return frame(Command.IDENTIFY_NON_CONFIGURED)


FASTSCAN_RESET: Final = 0x80
"""The bit check value with which a fastscan begins anew."""


def fastscan(id_number: int, bit_check: int, sub: int, following: int) -> bytes:
    """One step of a fastscan, answered by `Identified`.

    Meant are the unconfigured slaves whose part `sub` (0..3) of the identity equals `id_number` in the bits
    from 31 down to `bit_check`. After bit 0 they go on with part `following`.
    """
    return frame(Command.FASTSCAN, id_number.to_bytes(4, "little") + bytes((bit_check, sub, following)))


@dataclass(frozen=True, slots=True)
class Selected:
    """The slave whose identity was given is in configuration now."""


@dataclass(frozen=True, slots=True)
class Identified:
    """A slave is in the range, or agrees with a fastscan step."""


@dataclass(frozen=True, slots=True)
class NonConfigured:
    """A slave has no node-ID."""


@dataclass(frozen=True, slots=True)
class Configured:
    """A setting was taken, or not."""

    command: Command
    error: int
    """0: taken. 1: not supported. 2: STORE could not write. 255: see `specific`."""
    specific: int
    """The maker's error."""

    @property
    def succeeded(self) -> bool:
        """Whether it was taken."""
        return self.error == 0


@dataclass(frozen=True, slots=True)
class Inquired:
    """A part of the identity (32 bits), or the node-ID (8 bits)."""

    command: Command
    value: int


Answer: TypeAlias = Selected | Identified | NonConfigured | Configured | Inquired

_WITHOUT_DATA: Final[Mapping[int, Answer]] = MappingProxyType(
    {
        Command.SELECTED: Selected(),
        Command.IDENTIFIED: Identified(),
        Command.NON_CONFIGURED: NonConfigured(),
    }
)


def decode_answer(data: bytes) -> Answer | None:
    """What a slave answered, or None for what is no LSS answer."""
    if len(data) != 8:
        return None
    specifier = data[0]
    if specifier in _WITHOUT_DATA:
        return _WITHOUT_DATA[specifier]
    if specifier in _CONFIGURE_COMMANDS:
        return Configured(Command(specifier), data[1], data[2])
    if specifier in INQUIRE_COMMANDS:
        return Inquired(Command(specifier), int.from_bytes(data[1:5], "little"))
    if specifier == Command.INQUIRE_NODE_ID:
        return Inquired(Command.INQUIRE_NODE_ID, data[1])
    return None
