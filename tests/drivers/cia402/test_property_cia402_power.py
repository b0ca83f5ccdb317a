"""Every 16-bit word has a meaning that never surprises, whatever a drive says or is told."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from drivers.cia402.homing import HomingHandshake, HomingOutcome
from drivers.cia402.modes import Mode, mode_bits, supported_modes
from drivers.cia402.power import (
    Controlword,
    PowerState,
    Unreachable,
    command_of,
    decode_state,
    encode_state,
    holding_controlword,
    next_controlword,
    transition,
)
from drivers.cia402.setpoint import SetPointHandshake, SetPointStep

words = st.integers(0, 0xFFFF)
states = st.sampled_from(PowerState)
POWERED = {PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE}


@given(words)
def test_a_statusword_is_one_state_or_none(statusword: int) -> None:
    state = decode_state(statusword)
    if state is not None:
        mask = encode_state(state)
        assert statusword & mask == mask


@given(states, words, words)
def test_only_enable_operation_powers_a_motor(state: PowerState, word: int, previous: int) -> None:
    after = transition(state, word, previous)
    command_of(word)
    if after is PowerState.OPERATION_ENABLED:
        assert word & 0x8F == 0x0F
    if after in POWERED and state not in POWERED:
        assert state in (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON)


@given(words, words)
def test_a_fault_is_left_by_a_rising_bit_7_and_nothing_else(word: int, previous: int) -> None:
    rising = bool(word & 0x80) and not previous & 0x80
    after = transition(PowerState.FAULT, word, previous)
    assert after is (PowerState.SWITCH_ON_DISABLED if rising else None)


@given(states, states, st.lists(st.booleans(), max_size=20))
def test_the_way_to_a_goal_ends_there_however_often_a_frame_is_lost(
    state: PowerState, goal: PowerState, losses: list[bool]
) -> None:
    previous = 0
    for lost in [*losses, *[False] * 4]:
        try:
            word = next_controlword(state, goal)
        except Unreachable:
            return
        if word is None:
            break
        if state is PowerState.OPERATION_ENABLED:
            assert word in (Controlword.DISABLE_OPERATION, Controlword.QUICK_STOP)
        if not lost:
            state = transition(state, word, previous) or state
            previous = word
    assert state is goal or state is PowerState.NOT_READY_TO_SWITCH_ON


@given(states, words)
def test_a_holding_word_holds_whatever_came_before(state: PowerState, previous: int) -> None:
    assert transition(state, holding_controlword(state), previous) is None


@given(st.integers(0, 0xFFFFFFFF))
def test_any_6502h_can_be_read(bits: int) -> None:
    modes = supported_modes(bits)
    assert Mode.NO_MODE not in modes
    assert mode_bits(modes) & ~bits == 0
    assert supported_modes(mode_bits(modes)) == modes


@given(words, st.lists(st.tuples(words, st.floats(0.0, 0.2)), max_size=30), st.booleans())
def test_bit_4_is_lowered_within_the_grace_whatever_the_drive_says(
    before: int, said: list[tuple[int, float]], relative: bool
) -> None:
    handshake = SetPointHandshake(0.1)
    controlword = handshake.start(before, 0.0, relative=relative)
    assert controlword & 0xFF in (0x1F, 0x5F)
    now = 0.0
    releases = 0
    for statusword, elapsed in said:
        now += elapsed
        step = handshake.feed(statusword, now)
        releases += step is SetPointStep.RELEASE
        assert handshake.bit4_high == (step is SetPointStep.WAIT and releases == 0)
        assert not (handshake.bit4_high and now >= 0.1)
        assert not handshake.release_controlword & Controlword.NEW_SET_POINT
        if step is SetPointStep.DONE:
            assert releases == 1
    assert releases <= 1
    handshake.on_time(now + 0.1)
    assert not handshake.bit4_high


@given(st.booleans(), words, st.lists(st.tuples(words, st.floats(0.0, 0.2)), max_size=30))
def test_homing_is_attained_only_on_bits_10_and_12(
    moves: bool, before: int, said: list[tuple[int, float]]
) -> None:
    handshake = HomingHandshake(moves=moves, grace_s=0.1)
    handshake.start(before, 0.0)
    now = 0.0
    for statusword, elapsed in said:
        now += elapsed
        outcome = handshake.feed(statusword, now)
        if outcome is HomingOutcome.ATTAINED:
            assert statusword & 0x1400 == 0x1400
            assert handshake.began or not moves
        if outcome is HomingOutcome.STOPPED:
            assert statusword & 0x5400 == 0x0400
        assert not handshake.release_controlword & Controlword.START_HOMING
