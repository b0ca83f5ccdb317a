"""The power drive state machine against the manual's tables."""

from __future__ import annotations

import itertools

import pytest

from drivers.cia402.power import (
    Command,
    Controlword,
    PowerState,
    Statusword,
    Unreachable,
    command_of,
    decode_state,
    encode_state,
    holding_controlword,
    next_controlword,
    transition,
)

S = PowerState
LADDER = (S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON, S.SWITCHED_ON, S.OPERATION_ENABLED)


@pytest.mark.parametrize(
    ("statusword", "state"),
    [
        (0x0000, S.NOT_READY_TO_SWITCH_ON),
        (0x0020, S.NOT_READY_TO_SWITCH_ON),
        (0x0240, S.SWITCH_ON_DISABLED),
        (0x0260, S.SWITCH_ON_DISABLED),
        (0x0231, S.READY_TO_SWITCH_ON),
        (0x0233, S.SWITCHED_ON),
        (0x0637, S.OPERATION_ENABLED),
        (0x0217, S.QUICK_STOP_ACTIVE),
        (0x020F, S.FAULT_REACTION_ACTIVE),
        (0x023F, S.FAULT_REACTION_ACTIVE),
        (0x0208, S.FAULT),
        (0x0238, S.FAULT),
        (0x0001, None),
        (0x0061, None),
        (0x004F, None),
    ],
)
def test_a_statusword_codes_its_state(statusword: int, state: PowerState | None) -> None:
    assert decode_state(statusword) is state


def test_each_state_is_read_back_from_its_own_coding_whatever_the_other_bits() -> None:
    for state in PowerState:
        for other in (0, Statusword.VOLTAGE_ENABLED | Statusword.REMOTE, 0xFF90):
            assert decode_state(encode_state(state) | other) is state


@pytest.mark.parametrize(
    ("controlword", "command"),
    [
        (0x06, Command.SHUTDOWN),
        (0x0E, Command.SHUTDOWN),
        (0x07, Command.SWITCH_ON),
        (0x0F, Command.ENABLE_OPERATION),
        (0x1F, Command.ENABLE_OPERATION),
        (0x10F, Command.ENABLE_OPERATION),
        (0x00, Command.DISABLE_VOLTAGE),
        (0x0D, Command.DISABLE_VOLTAGE),
        (0x02, Command.QUICK_STOP),
        (0x0B, Command.QUICK_STOP),
        (0x80, Command.FAULT_RESET),
        (0x8F, Command.FAULT_RESET),
    ],
)
def test_a_controlword_is_one_command(controlword: int, command: Command) -> None:
    assert command_of(controlword) is command


# Typed from manual §6.1.1 and figure 9: number, from, controlword, to.
TRANSITIONS = [
    (2, S.SWITCH_ON_DISABLED, 0x06, S.READY_TO_SWITCH_ON),
    (3, S.READY_TO_SWITCH_ON, 0x07, S.SWITCHED_ON),
    (4, S.SWITCHED_ON, 0x0F, S.OPERATION_ENABLED),
    (34, S.READY_TO_SWITCH_ON, 0x0F, S.OPERATION_ENABLED),
    (5, S.OPERATION_ENABLED, 0x07, S.SWITCHED_ON),
    (6, S.SWITCHED_ON, 0x06, S.READY_TO_SWITCH_ON),
    (7, S.READY_TO_SWITCH_ON, 0x00, S.SWITCH_ON_DISABLED),
    (7, S.READY_TO_SWITCH_ON, 0x02, S.SWITCH_ON_DISABLED),
    (8, S.OPERATION_ENABLED, 0x06, S.READY_TO_SWITCH_ON),
    (9, S.OPERATION_ENABLED, 0x00, S.SWITCH_ON_DISABLED),
    (10, S.SWITCHED_ON, 0x00, S.SWITCH_ON_DISABLED),
    (10, S.SWITCHED_ON, 0x02, S.SWITCH_ON_DISABLED),
    (11, S.OPERATION_ENABLED, 0x02, S.QUICK_STOP_ACTIVE),
    (12, S.QUICK_STOP_ACTIVE, 0x00, S.SWITCH_ON_DISABLED),
    (15, S.FAULT, 0x80, S.SWITCH_ON_DISABLED),
    (16, S.QUICK_STOP_ACTIVE, 0x0F, S.OPERATION_ENABLED),
]
WORDS = (0x00, 0x02, 0x06, 0x07, 0x0F, 0x80)


@pytest.mark.parametrize(("number", "state", "controlword", "expected"), TRANSITIONS)
def test_a_transition_of_the_manual(
    number: int, state: PowerState, controlword: int, expected: PowerState
) -> None:
    assert transition(state, controlword, 0) is expected


def test_there_are_no_other_transitions() -> None:
    listed = {(state, word) for _, state, word, _ in TRANSITIONS}
    for state, word in itertools.product(PowerState, WORDS):
        if (state, word) not in listed:
            assert transition(state, word, 0) is None, (state, hex(word))


def test_a_fault_is_reset_by_the_edge_of_bit_7_only() -> None:
    assert transition(S.FAULT, 0x80, 0x0F) is S.SWITCH_ON_DISABLED
    assert transition(S.FAULT, 0x8F, 0x00) is S.SWITCH_ON_DISABLED
    assert transition(S.FAULT, 0x80, 0x80) is None
    assert transition(S.FAULT, 0x00, 0x80) is None
    assert transition(S.FAULT_REACTION_ACTIVE, 0x80, 0x00) is None
    assert transition(S.SWITCH_ON_DISABLED, 0x86, 0x80) is None


def path(state: PowerState, goal: PowerState) -> list[int]:
    """The controlwords from a state to a goal, with the drive obeying the table."""
    words: list[int] = []
    while (word := next_controlword(state, goal)) is not None:
        after = transition(state, word, 0)
        assert after is not None, f"{state} does not obey {word:02X}h"
        state = after
        words.append(word)
        assert len(words) <= 4
    assert state is goal
    return words


def test_enabling_goes_6_7_15() -> None:
    assert path(S.SWITCH_ON_DISABLED, S.OPERATION_ENABLED) == [0x06, 0x07, 0x0F]


def test_disabling_ramps_with_7_before_the_power_goes() -> None:
    assert path(S.OPERATION_ENABLED, S.SWITCH_ON_DISABLED) == [0x07, 0x06, 0x00]
    assert path(S.OPERATION_ENABLED, S.READY_TO_SWITCH_ON) == [0x07, 0x06]


def test_a_quick_stop_is_left_upwards_by_15_and_downwards_by_0() -> None:
    assert path(S.QUICK_STOP_ACTIVE, S.OPERATION_ENABLED) == [0x0F]
    assert path(S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED) == [0x00]
    assert path(S.QUICK_STOP_ACTIVE, S.SWITCHED_ON) == [0x00, 0x06, 0x07]
    assert path(S.OPERATION_ENABLED, S.QUICK_STOP_ACTIVE) == [0x02]


@pytest.mark.parametrize(("state", "goal"), list(itertools.product((*LADDER, S.QUICK_STOP_ACTIVE), LADDER)))
def test_every_goal_is_reached_from_every_state_without_a_fault(state: PowerState, goal: PowerState) -> None:
    assert len(path(state, goal)) <= 3


@pytest.mark.parametrize("goal", LADDER[:-1])
def test_the_first_word_from_operation_enabled_never_cuts_the_power(goal: PowerState) -> None:
    assert next_controlword(S.OPERATION_ENABLED, goal) == Controlword.DISABLE_OPERATION


@pytest.mark.parametrize("state", [S.FAULT, S.FAULT_REACTION_ACTIVE])
@pytest.mark.parametrize("goal", LADDER)
def test_no_controlword_of_the_ladder_leads_out_of_a_fault(state: PowerState, goal: PowerState) -> None:
    with pytest.raises(Unreachable, match=f"from {state} to {goal}") as caught:
        next_controlword(state, goal)
    assert (caught.value.state, caught.value.goal) == (state, goal)


@pytest.mark.parametrize("goal", [S.NOT_READY_TO_SWITCH_ON, S.FAULT_REACTION_ACTIVE, S.FAULT])
def test_a_fault_is_no_goal(goal: PowerState) -> None:
    with pytest.raises(Unreachable):
        next_controlword(S.OPERATION_ENABLED, goal)
    assert next_controlword(goal, goal) is None


def test_a_quick_stop_needs_an_enabled_drive() -> None:
    for state in (S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON, S.SWITCHED_ON):
        with pytest.raises(Unreachable):
            next_controlword(state, S.QUICK_STOP_ACTIVE)


def test_a_drive_that_is_not_ready_yet_is_told_nothing() -> None:
    word = next_controlword(S.NOT_READY_TO_SWITCH_ON, S.OPERATION_ENABLED)
    assert word == Controlword.DISABLE_VOLTAGE
    assert transition(S.NOT_READY_TO_SWITCH_ON, word, 0) is None


@pytest.mark.parametrize("state", list(PowerState))
def test_the_holding_word_changes_nothing(state: PowerState) -> None:
    assert transition(state, holding_controlword(state), 0) is None
    assert not holding_controlword(state) & (Controlword.NEW_SET_POINT | Controlword.FAULT_RESET)


def test_status_bits_are_where_the_manual_has_them() -> None:
    assert Statusword.TARGET_REACHED == 0x0400
    assert Statusword.BIT12 == 0x1000
    assert Statusword.MOTOR_ACTIVITY == 0x4000
    assert Statusword.DIRECTION == 0x8000
    assert Controlword.ENABLE_OPERATION | Controlword.NEW_SET_POINT == 31  # manual §6.2
    assert Controlword.ENABLE_OPERATION | Controlword.START_HOMING == 31  # manual §8.3
