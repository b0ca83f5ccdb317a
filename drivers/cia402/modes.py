"""Modes of operation as rows: the code in 6060h, target, read-back, and how a target is handed over."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from drivers.cia301.objects import Address
from drivers.cia402 import objects


class Mode(enum.IntEnum):
    """A value of 6060h and 6061h."""

    NO_MODE = 0
    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    HOMING = 6
    CYCLIC_SYNC_POSITION = 8
    CYCLIC_SYNC_VELOCITY = 9
    CYCLIC_SYNC_TORQUE = 10

    @property
    def short(self) -> str:
        """CiA 402's abbreviation, ``none`` for no mode."""
        return _SHORT[self]


_SHORT: Final[dict[Mode, str]] = {
    Mode.NO_MODE: "none",
    Mode.PROFILE_POSITION: "pp",
    Mode.PROFILE_VELOCITY: "pv",
    Mode.HOMING: "hm",
    Mode.CYCLIC_SYNC_POSITION: "csp",
    Mode.CYCLIC_SYNC_VELOCITY: "csv",
    Mode.CYCLIC_SYNC_TORQUE: "cst",
}


class Handshake(enum.Enum):
    """How the drive is told that a target, or a start, is meant."""

    NONE = enum.auto()
    """There is no target."""
    SET_POINT = enum.auto()
    """A 0-to-1 edge of controlword bit 4, answered by statusword bit 12 (`drivers.cia402.setpoint`)."""
    START_BIT = enum.auto()
    """Controlword bit 4 high for as long as it runs (`drivers.cia402.homing`)."""
    DIRECT = enum.auto()
    """Writing the target is enough."""


@dataclass(frozen=True, slots=True)
class ModeSpec:
    """One mode. Addresses are those of axis 0."""

    mode: Mode
    target: Address | None
    """Where the set point goes."""
    read_back: Address | None
    """Which actual value follows it."""
    handshake: Handshake
    ramped: bool
    """Whether the drive makes the ramp; if not, the master must."""


def _row(
    mode: Mode, target: int | None, read_back: int | None, handshake: Handshake, *, ramped: bool
) -> tuple[Mode, ModeSpec]:
    return mode, ModeSpec(
        mode,
        None if target is None else Address(target),
        None if read_back is None else Address(read_back),
        handshake,
        ramped,
    )


MODES: Final[Mapping[Mode, ModeSpec]] = MappingProxyType(
    dict(
        (
            _row(Mode.NO_MODE, None, None, Handshake.NONE, ramped=False),
            _row(
                Mode.PROFILE_POSITION,
                objects.TARGET_POSITION,
                objects.POSITION,
                Handshake.SET_POINT,
                ramped=True,
            ),
            _row(
                Mode.PROFILE_VELOCITY,
                objects.TARGET_VELOCITY,
                objects.VELOCITY,
                Handshake.DIRECT,
                ramped=True,
            ),
            _row(Mode.HOMING, None, objects.POSITION, Handshake.START_BIT, ramped=True),
            _row(
                Mode.CYCLIC_SYNC_POSITION,
                objects.TARGET_POSITION,
                objects.POSITION,
                Handshake.DIRECT,
                ramped=False,
            ),
            _row(
                Mode.CYCLIC_SYNC_VELOCITY,
                objects.TARGET_VELOCITY,
                objects.VELOCITY,
                Handshake.DIRECT,
                ramped=False,
            ),
            _row(
                Mode.CYCLIC_SYNC_TORQUE,
                objects.TARGET_TORQUE,
                objects.TORQUE,
                Handshake.DIRECT,
                ramped=False,
            ),
        )
    )
)
"""Every mode that is known here; which of them a drive has is in its profile and in 6502h."""


def supported_modes(bits_of_6502: int) -> frozenset[Mode]:
    """The modes that 6502h names (manual §5.1.11); bits of modes unknown here are passed over.

    Bit n is mode n + 1. `Mode.NO_MODE` has no bit and is not in the result.
    """
    return frozenset(mode for mode in Mode if mode and bits_of_6502 >> mode - 1 & 1)


def mode_bits(modes: frozenset[Mode]) -> int:
    """The value of 6502h for a set of modes: the inverse of `supported_modes`."""
    return sum(1 << mode - 1 for mode in modes if mode)
