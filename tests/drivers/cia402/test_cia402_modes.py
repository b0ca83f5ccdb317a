"""The rows of the modes, and the methods of homing."""

from __future__ import annotations

import pytest

from drivers.cia301.objects import Address
from drivers.cia402.homing import HOMING_METHODS, HomingSignal
from drivers.cia402.modes import MODES, Handshake, Mode, mode_bits, supported_modes


def test_every_mode_has_a_row_and_a_short_name() -> None:
    assert set(MODES) == set(Mode)
    assert [mode.short for mode in Mode] == ["none", "pp", "pv", "hm", "csp", "csv", "cst"]
    assert all(MODES[mode].mode is mode for mode in Mode)


@pytest.mark.parametrize(
    ("mode", "target", "read_back", "handshake", "ramped"),
    [
        (Mode.NO_MODE, None, None, Handshake.NONE, False),
        (Mode.PROFILE_POSITION, 0x607A, 0x6064, Handshake.SET_POINT, True),
        (Mode.PROFILE_VELOCITY, 0x60FF, 0x606C, Handshake.DIRECT, True),
        (Mode.HOMING, None, 0x6064, Handshake.START_BIT, True),
        (Mode.CYCLIC_SYNC_POSITION, 0x607A, 0x6064, Handshake.DIRECT, False),
        (Mode.CYCLIC_SYNC_VELOCITY, 0x60FF, 0x606C, Handshake.DIRECT, False),
        (Mode.CYCLIC_SYNC_TORQUE, 0x6071, 0x6077, Handshake.DIRECT, False),
    ],
)
def test_a_row(
    mode: Mode, target: int | None, read_back: int | None, handshake: Handshake, ramped: bool
) -> None:
    row = MODES[mode]
    assert row.target == (None if target is None else Address(target))
    assert row.read_back == (None if read_back is None else Address(read_back))
    assert (row.handshake, row.ramped) == (handshake, ramped)


def test_6502h_names_the_modes() -> None:
    pp_pv_hm_cst = {Mode.PROFILE_POSITION, Mode.PROFILE_VELOCITY, Mode.HOMING, Mode.CYCLIC_SYNC_TORQUE}
    assert supported_modes(549) == pp_pv_hm_cst
    assert supported_modes(0b1_1010_0101) == {
        Mode.PROFILE_POSITION,
        Mode.PROFILE_VELOCITY,
        Mode.HOMING,
        Mode.CYCLIC_SYNC_POSITION,
        Mode.CYCLIC_SYNC_VELOCITY,
    }
    assert supported_modes(0xFFFFFFFF) == set(Mode) - {Mode.NO_MODE}
    assert supported_modes(0) == set()
    assert mode_bits(frozenset(pp_pv_hm_cst | {Mode.NO_MODE})) == 549


def test_the_twelve_homing_methods_of_the_manual() -> None:
    assert list(HOMING_METHODS) == [0, 1, 2, 3, 5, 17, 18, 19, 21, 33, 34, 35]
    assert all(method.number == number for number, method in HOMING_METHODS.items())
    assert {n for n, m in HOMING_METHODS.items() if not m.moves} == {0, 35}
    assert {n for n, m in HOMING_METHODS.items() if HomingSignal.INDEX in m.uses} == {1, 2, 3, 5, 33, 34}
    assert {n for n, m in HOMING_METHODS.items() if HomingSignal.NEGATIVE_LIMIT in m.uses} == {1, 17}
    assert {n for n, m in HOMING_METHODS.items() if HomingSignal.POSITIVE_LIMIT in m.uses} == {2, 18}
    assert {n for n, m in HOMING_METHODS.items() if HomingSignal.HOME_SWITCH in m.uses} == {3, 5, 19, 21}
    assert len({m.title for m in HOMING_METHODS.values()}) == 12
