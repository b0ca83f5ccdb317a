"""Whatever a client, a network and other people do: nothing turns without a hold in the last half second.

The session is driven together with the axis's dead man, as the socket drives them, on a clock that the test
turns. The drawn order of events includes holds that were under way for long, and answers that come late.
"""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from app.jog.session import Hold, JogSession

SILENCE = 0.5


class Jogging(RuleBasedStateMachine):
    """A session, an axis that may begin, turn and come to rest, and what is known of the truth."""

    def __init__(self) -> None:
        super().__init__()
        self.session = JogSession(SILENCE)
        self.now = 100.0
        self.sequence = 0
        self.press = 0
        self.starting = False
        self.turning = False
        self.resting: bool | None = None
        """Whether what comes to rest was released."""
        self.began: list[int] = []
        """The presses for which something turned."""
        self.last_fresh = -1.0
        """When the last hold came whose sender had seen something of the last half second."""
        self.fed = -1.0
        """What the axis's dead man knows."""

    @rule(seconds=st.sampled_from([0.01, 0.1, 0.2, 0.4, 0.6]))
    def time_passes(self, seconds: float) -> None:
        steps = round(seconds / 0.01)
        for _ in range(steps):
            self.now += 0.01
            if self.turning and self.now - self.fed >= SILENCE:
                self.ends(released=False)
            self.judge()

    @rule(age=st.sampled_from([0.0, 0.05, 0.3, 0.7, 5.0]), repeated=st.booleans())
    def hold(self, age: float, repeated: bool) -> None:
        repeated = repeated and self.sequence > 0
        self.sequence += not repeated
        became = self.session.hold(self.sequence, self.now, self.now - age)
        if age <= SILENCE and not repeated:
            self.last_fresh = self.now
        if became is Hold.BEGINS:
            assert (self.starting, self.turning, self.resting) == (False, False, None), "one at a time"
            self.starting = True
        if became.counts:
            assert age <= SILENCE
            self.fed = self.now

    @precondition(lambda self: self.starting)
    @rule(refused=st.booleans())
    def begin(self, refused: bool) -> None:
        """What was asked for is written down by now: it begins, or is not wanted any more, or is refused."""
        self.starting = False
        if not self.session.begins(self.now):
            assert not self.session.busy
        elif refused:
            self.session.refused()
        else:
            self.turning, self.fed = True, self.session.held_at
            self.began.append(self.press)

    @rule()
    def release(self) -> None:
        self.session.release()
        self.press += 1
        if self.turning:
            self.ends(released=True)

    @precondition(lambda self: self.turning)
    @rule()
    def somebody_stops_it(self) -> None:
        self.ends(released=False)

    @rule()
    def the_connection_ends(self) -> None:
        self.session.use_up()
        if self.turning:
            self.ends(released=False)

    @precondition(lambda self: self.resting is not None)
    @rule()
    def stands(self) -> None:
        assert self.resting is not None
        released, self.resting = self.resting, None
        self.session.at_rest(released=released)
        assert not self.session.busy

    def ends(self, *, released: bool) -> None:
        self.resting, self.turning = released, False

    @invariant()
    def judge(self) -> None:
        if self.turning:
            assert self.now - self.last_fresh < SILENCE + 0.011, "it turns, and nobody holds"

    @invariant()
    def one_beginning_a_press(self) -> None:
        """A press that ended by anything but its release begins nothing any more."""
        assert len(set(self.began)) == len(self.began), "the axis stutters"


TestJogging = Jogging.TestCase
TestJogging.settings = settings(max_examples=40, stateful_step_count=40, deadline=None)


def test_a_hold_counts_again_after_the_release_only() -> None:
    session = JogSession(SILENCE)
    assert session.hold(1, 0.0, 0.0) is Hold.BEGINS
    assert session.begins(0.01)
    assert session.hold(2, 0.2, 0.2) is Hold.COUNTS
    session.at_rest(released=False)
    assert session.hold(3, 0.4, 0.4) is Hold.USED_UP
    session.release()
    assert session.hold(4, 0.6, 0.6) is Hold.BEGINS


def test_a_press_during_the_ramp_down_of_the_last_begins_when_that_stands() -> None:
    session = JogSession(SILENCE)
    assert session.hold(1, 0.0, 0.0) is Hold.BEGINS
    assert session.begins(0.01)
    session.release()
    assert session.hold(2, 0.1, 0.1) is Hold.COUNTS
    session.at_rest(released=True)
    assert session.hold(3, 0.3, 0.3) is Hold.BEGINS


def test_what_was_let_go_before_it_could_begin_uses_no_press_up() -> None:
    session = JogSession(SILENCE)
    assert session.hold(1, 0.0, 0.0) is Hold.BEGINS
    session.release()
    assert not session.begins(0.1)
    assert session.hold(2, 0.2, 0.2) is Hold.BEGINS


@pytest.mark.parametrize("seen", [-0.6, 0.01])
def test_what_was_seen_too_long_ago_or_not_yet_counts_for_nothing(seen: float) -> None:
    session = JogSession(SILENCE)
    assert session.hold(1, 0.0, seen) is Hold.STALE
    assert session.held_at < 0
    assert session.hold(1, 0.0, 0.0) is Hold.OUT_OF_ORDER
