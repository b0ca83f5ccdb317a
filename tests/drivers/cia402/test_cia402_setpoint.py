"""The set-point handshake, with drives that mean different things by bit 12."""

from __future__ import annotations

import pytest

from drivers.cia402.power import Controlword, PowerState, Statusword, encode_state
from drivers.cia402.setpoint import Evidence, SetPointHandshake, SetPointStep

GRACE = 0.1
ENABLED = encode_state(PowerState.OPERATION_ENABLED) | Statusword.VOLTAGE_ENABLED | Statusword.REMOTE
RESTING = ENABLED | Statusword.TARGET_REACHED
PROCESSING = ENABLED | Statusword.BIT12
MOVING = ENABLED | Statusword.MOTOR_ACTIVITY
STEP = SetPointStep


@pytest.fixture
def handshake() -> SetPointHandshake:
    return SetPointHandshake(GRACE)


def steps(handshake: SetPointHandshake, *statuswords: int, start: int = RESTING) -> list[SetPointStep]:
    """Start at 0.0 and feed a statusword each millisecond."""
    handshake.start(start, 0.0)
    return [handshake.feed(word, 0.001 * n) for n, word in enumerate(statuswords, start=1)]


def test_the_start_is_31_and_relative_adds_bit_6(handshake: SetPointHandshake) -> None:
    assert handshake.start(RESTING, 0.0) == 31
    assert handshake.bit4_high
    assert handshake.start(RESTING, 0.0, relative=True) == 31 + 64
    assert handshake.release_controlword == 15


def test_a_drive_that_acknowledges_while_bit_4_is_high(handshake: SetPointHandshake) -> None:
    assert steps(handshake, RESTING, PROCESSING, PROCESSING, MOVING) == [
        STEP.WAIT,
        STEP.RELEASE,
        STEP.WAIT,
        STEP.DONE,
    ]
    assert handshake.evidence is Evidence.ACKNOWLEDGED
    assert not handshake.bit4_high


def test_a_drive_that_shows_bit_12_for_the_whole_motion(handshake: SetPointHandshake) -> None:
    moving = MOVING | Statusword.BIT12
    assert steps(handshake, PROCESSING, moving, moving, RESTING) == [
        STEP.RELEASE,
        STEP.WAIT,
        STEP.WAIT,
        STEP.DONE,
    ]


def test_a_drive_too_fast_to_be_seen_processing_is_known_by_its_motion(handshake: SetPointHandshake) -> None:
    assert steps(handshake, MOVING, MOVING) == [STEP.RELEASE, STEP.DONE]
    assert handshake.evidence is Evidence.MOTION


def test_a_drive_too_fast_to_be_seen_processing_is_known_by_bit_10_falling(
    handshake: SetPointHandshake,
) -> None:
    assert steps(handshake, ENABLED, ENABLED) == [STEP.RELEASE, STEP.DONE]
    assert handshake.evidence is Evidence.TARGET_LEFT


def test_a_drive_that_shows_nothing_is_released_by_time(handshake: SetPointHandshake) -> None:
    handshake.start(RESTING, 5.0)
    assert handshake.deadline == 5.0 + GRACE
    assert handshake.feed(RESTING, 5.05) is STEP.WAIT
    assert handshake.on_time(5.099) is STEP.WAIT
    assert handshake.on_time(5.0 + GRACE) is STEP.RELEASE
    assert handshake.deadline is None
    assert not handshake.bit4_high
    # Time alone never says that the set point was processed.
    assert handshake.on_time(99.0) is STEP.WAIT
    assert handshake.feed(RESTING, 99.0) is STEP.DONE
    assert handshake.evidence is Evidence.NONE


def test_a_statusword_after_the_grace_releases_too(handshake: SetPointHandshake) -> None:
    handshake.start(RESTING, 0.0)
    assert handshake.feed(RESTING, GRACE) is STEP.RELEASE


def test_evidence_that_comes_after_the_release_still_counts(handshake: SetPointHandshake) -> None:
    handshake.start(RESTING, 0.0)
    assert handshake.on_time(GRACE) is STEP.RELEASE
    assert handshake.feed(PROCESSING, 0.2) is STEP.WAIT
    assert handshake.feed(MOVING, 0.3) is STEP.DONE
    assert handshake.evidence is Evidence.ACKNOWLEDGED


def test_bits_that_were_there_before_the_start_are_no_evidence(handshake: SetPointHandshake) -> None:
    busy = MOVING | Statusword.BIT12
    assert steps(handshake, busy, busy, start=busy) == [STEP.WAIT, STEP.WAIT]
    assert handshake.evidence is Evidence.NONE
    assert handshake.on_time(GRACE) is STEP.RELEASE


def test_bit_12_that_falls_and_rises_again_is_evidence(handshake: SetPointHandshake) -> None:
    busy = MOVING | Statusword.BIT12
    assert steps(handshake, MOVING, busy, MOVING, start=busy) == [STEP.WAIT, STEP.RELEASE, STEP.DONE]


@pytest.mark.parametrize(
    ("state", "release"),
    [
        (PowerState.FAULT, 0x00),
        (PowerState.FAULT_REACTION_ACTIVE, 0x00),
        (PowerState.SWITCH_ON_DISABLED, 0x00),
        (PowerState.QUICK_STOP_ACTIVE, Controlword.QUICK_STOP),
        (PowerState.READY_TO_SWITCH_ON, Controlword.SHUTDOWN),
        (PowerState.SWITCHED_ON, Controlword.SWITCH_ON),
    ],
)
def test_a_drive_that_leaves_the_state_is_lost_and_not_enabled_again(
    handshake: SetPointHandshake, state: PowerState, release: int
) -> None:
    handshake.start(RESTING, 0.0)
    assert handshake.feed(encode_state(state), 0.01) is STEP.LOST
    assert handshake.release_controlword == release
    assert not handshake.bit4_high
    assert handshake.feed(RESTING, 0.02) is STEP.LOST
    assert handshake.on_time(9.0) is STEP.LOST


def test_a_pattern_that_is_no_state_loses_nothing(handshake: SetPointHandshake) -> None:
    assert steps(handshake, 0x0001 | Statusword.TARGET_REACHED, PROCESSING) == [STEP.WAIT, STEP.RELEASE]


def test_abandoning_lowers_bit_4_once(handshake: SetPointHandshake) -> None:
    handshake.start(RESTING, 0.0)
    assert handshake.abandon() == 15
    assert handshake.abandon() is None
    assert handshake.deadline is None
    handshake.start(RESTING, 0.0)
    handshake.feed(PROCESSING, 0.01)
    assert handshake.abandon() is None


def test_one_handshake_serves_one_set_point_after_the_other(handshake: SetPointHandshake) -> None:
    assert steps(handshake, PROCESSING, RESTING) == [STEP.RELEASE, STEP.DONE]
    assert steps(handshake, RESTING, MOVING, RESTING) == [STEP.WAIT, STEP.RELEASE, STEP.DONE]
    assert handshake.evidence is Evidence.MOTION


@pytest.mark.parametrize("grace", [0.0, -1.0, float("nan")])
def test_no_grace_is_refused(grace: float) -> None:
    with pytest.raises(ValueError, match="grace"):
        SetPointHandshake(grace)
