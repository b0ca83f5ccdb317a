"""The outcome of a homing, told from the outcome before it."""

from __future__ import annotations

import pytest

from drivers.cia402.homing import HomingHandshake, HomingOutcome, outcome
from drivers.cia402.power import PowerState, Statusword, encode_state

GRACE = 0.1
ENABLED = encode_state(PowerState.OPERATION_ENABLED)
SEARCHING = ENABLED | Statusword.MOTOR_ACTIVITY
STOPPED = ENABLED | Statusword.TARGET_REACHED
ATTAINED = STOPPED | Statusword.BIT12
TURN = Statusword.MOTOR_ACTIVITY
O = HomingOutcome  # noqa: E741


def moving() -> HomingHandshake:
    return HomingHandshake(moves=True, grace_s=GRACE)


def outcomes(handshake: HomingHandshake, before: int, *timed: tuple[float, int]) -> list[HomingOutcome]:
    handshake.start(before, 0.0)
    return [handshake.feed(word, now) for now, word in timed]


@pytest.mark.parametrize(
    ("statusword", "expected"),
    [
        (ENABLED, O.RUNNING),
        (SEARCHING, O.RUNNING),
        (ENABLED | Statusword.BIT12, O.RUNNING),
        (STOPPED, O.STOPPED),
        (ATTAINED, O.ATTAINED),
    ],
)
def test_bits_10_and_12_code_the_outcome(statusword: int, expected: HomingOutcome) -> None:
    assert outcome(statusword) is expected


def test_a_homing_that_finds_home() -> None:
    handshake = moving()
    assert handshake.start(ENABLED, 0.0) == 31
    assert not handshake.began
    assert handshake.feed(SEARCHING, 0.01) is O.RUNNING
    assert handshake.began
    assert handshake.feed(ATTAINED, 3.0) is O.ATTAINED
    assert handshake.release_controlword == 15


def test_the_outcome_before_is_not_taken_for_this_one() -> None:
    assert outcomes(
        moving(), ATTAINED, (0.01, ATTAINED), (5.0, ATTAINED), (6.0, ENABLED), (7.0, ATTAINED)
    ) == [O.RUNNING, O.RUNNING, O.RUNNING, O.ATTAINED]


def test_a_target_reached_of_another_mode_is_not_taken_for_a_stop() -> None:
    assert outcomes(
        moving(), STOPPED, (0.01, STOPPED), (5.0, STOPPED), (5.1, SEARCHING), (6.0, ATTAINED)
    ) == [
        O.RUNNING,
        O.RUNNING,
        O.RUNNING,
        O.ATTAINED,
    ]


def test_bits_that_stay_set_count_when_the_motor_has_turned_and_rests() -> None:
    assert outcomes(
        moving(),
        ATTAINED,
        (0.01, ATTAINED | TURN),
        (1.00, ATTAINED | TURN),
        (1.05, ATTAINED),
        (1.10, ATTAINED),
    ) == [O.RUNNING, O.RUNNING, O.RUNNING, O.ATTAINED]


def test_bit_10_a_statusword_before_bit_12_is_no_stop() -> None:
    assert outcomes(moving(), ENABLED, (0.01, SEARCHING), (1.0, STOPPED), (1.005, ATTAINED)) == [
        O.RUNNING,
        O.RUNNING,
        O.ATTAINED,
    ]


def test_a_stop_is_told_at_standstill() -> None:
    handshake = moving()
    handshake.start(ENABLED, 0.0)
    handshake.feed(SEARCHING, 0.01)
    assert handshake.stop() == 15
    assert handshake.feed(STOPPED | TURN, 0.02) is O.RUNNING
    assert handshake.feed(STOPPED, 0.03) is O.STOPPED


def test_home_found_just_before_the_stop_is_found() -> None:
    handshake = moving()
    handshake.start(ENABLED, 0.0)
    handshake.feed(SEARCHING, 0.01)
    handshake.stop()
    assert handshake.feed(ATTAINED, 0.02) is O.ATTAINED


def test_a_stop_that_nobody_asked_for_is_told_when_it_lasts() -> None:
    assert outcomes(moving(), ENABLED, (0.01, SEARCHING), (1.0, STOPPED), (1.1, STOPPED)) == [
        O.RUNNING,
        O.RUNNING,
        O.STOPPED,
    ]


@pytest.mark.parametrize("before", [STOPPED, ATTAINED])
def test_a_stop_before_the_drive_began_ends_too(before: int) -> None:
    handshake = moving()
    handshake.start(before, 0.0)
    handshake.stop()
    assert handshake.feed(before, 0.05) is O.RUNNING
    assert handshake.feed(before, GRACE) is O.STOPPED


def test_method_35_needs_no_motion_and_no_change() -> None:
    handshake = HomingHandshake(moves=False, grace_s=GRACE)
    assert outcomes(handshake, ATTAINED, (0.05, ATTAINED), (GRACE, ATTAINED)) == [O.RUNNING, O.ATTAINED]
    assert outcomes(handshake, ENABLED, (0.001, ATTAINED)) == [O.ATTAINED]


@pytest.mark.parametrize(
    ("state", "hold"),
    [
        (PowerState.SWITCH_ON_DISABLED, 0x00),
        (PowerState.READY_TO_SWITCH_ON, 0x06),
        (PowerState.SWITCHED_ON, 0x07),
        (PowerState.OPERATION_ENABLED, 0x0F),
    ],
)
def test_the_start_keeps_the_drive_where_it_is(state: PowerState, hold: int) -> None:
    handshake = HomingHandshake(moves=False, grace_s=GRACE)
    assert handshake.start(encode_state(state), 0.0) == hold | 0x10
    assert handshake.release_controlword == hold


def test_a_drive_that_faults_meanwhile_is_not_enabled_by_the_release() -> None:
    handshake = moving()
    handshake.start(ENABLED, 0.0)
    handshake.feed(encode_state(PowerState.FAULT), 0.5)
    assert handshake.release_controlword == 0
    assert handshake.stop() == 0
