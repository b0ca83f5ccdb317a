"""Rows, deadlines and messages of the cyclic sender."""

from __future__ import annotations

import itertools

import pytest

from drivers.bus.base import Beside
from drivers.cyclic import messages
from drivers.cyclic.messages import Inbox
from drivers.cyclic.pace import Lateness, Pace
from drivers.cyclic.playback import Cause, Playback, rows_to_rest
from drivers.cyclic.sender import CyclePlan, Phase, Report, Track, row_frames


def test_rows_are_played_in_order_and_rounded_only_when_sent() -> None:
    playback = Playback((0.0,), (1.0,), 1)
    playback.feed([(0.4,), (0.6,), (1.4,)])
    playback.finish()
    assert [playback.next() for _ in range(4)] == [(0,), (1,), (1,), None]
    assert playback.standing
    assert playback.cause is Cause.NONE
    assert playback.taken == 3


def test_with_no_more_than_the_reserve_left_it_comes_to_rest() -> None:
    playback = Playback((0.0,), (2.0,), 3)
    rows = [(2.0,), (6.0,), (12.0,), (20.0,), (28.0,), (36.0,), (44.0,)]
    playback.feed(rows)
    sent = []
    while (row := playback.next()) is not None:
        sent.append(row[0])
    assert playback.cause is Cause.UNDER_RUN
    assert not playback.abrupt
    assert sent == [2, 6, 12, 20, 26, 30, 32]


TOP = 20.0
"""Steps a cycle. On the paths below a speed changes by 1 a cycle at most, so a ramp takes 20 cycles."""
UP, ROUND = [(1.0, 0.0)] * 20, [(-1.0, 1.0)] * 20
PATHS = {
    "a straight line": [*UP, *[(0.0, 0.0)] * 150],
    "a corner": [*UP, *[(0.0, 0.0)] * 10, *ROUND, *[(0.0, 0.0)] * 120],
    "corner after corner": [*UP, *[*ROUND, *[(1.0, -1.0)] * 20] * 4],
    "never even": [*[(1.0, 1.0)] * 20, *[*[(-1.0, 1.0)] * 5, *[(1.0, -1.0)] * 5] * 15],
}
"""By how much the speeds change, cycle by cycle."""


def rows_of(bends: list[tuple[float, float]]) -> list[tuple[float, float]]:
    here, speed, rows = (0.0, 0.0), (0.0, 0.0), []
    for x, y in bends:
        speed = min(TOP, speed[0] + x), min(TOP, speed[1] + y)
        here = here[0] + speed[0], here[1] + speed[1]
        rows.append(here)
    return rows


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("braking", [1.0, 0.6])
def test_wherever_the_rows_stop_coming_those_kept_back_are_enough_to_come_to_rest(
    path: str, braking: float
) -> None:
    """Though the path brakes one axis or another as hard as it may, and harder than they are to brake."""
    rows, reserve = rows_of(PATHS[path]), rows_to_rest(TOP, braking)
    for kept in range(reserve + 1, len(rows), 2):
        playback = Playback((0.0, 0.0), (braking, braking), reserve, (1.0, 1.0))
        playback.feed(rows[:kept])
        sent: list[tuple[int, ...]] = [(0, 0), (0, 0)]
        while (row := playback.next()) is not None:
            sent.append(row)
        assert playback.cause is Cause.UNDER_RUN
        assert not playback.abrupt, kept
        changes = [
            abs(c - 2 * b + a)
            for first, second, third in zip(sent, sent[1:], [*sent[2:], sent[-1]], strict=False)
            for a, b, c in zip(first, second, third, strict=True)
        ]
        assert max(changes) <= 1 + 2, "rounding, no jerk"


def test_a_steep_part_elsewhere_makes_no_ramp_steeper_where_the_path_is_calm() -> None:
    playback = Playback((0.0,), (1.0,), 0, (5.0,))
    playback.feed((place,) for place in itertools.accumulate([5.0, 10.0, 15.0, *[20.0] * 40]))
    sent = [playback.next() for _ in range(10)]
    playback.brake(Cause.ASKED)
    while (row := playback.next()) is not None:
        sent.append(row)
    speeds = [b[0] - a[0] for a, b in itertools.pairwise(row for row in sent if row)]
    assert max(a - b for a, b in itertools.pairwise(speeds)) <= 1 + 2
    assert not playback.abrupt


def test_rows_that_end_in_full_speed_are_told() -> None:
    playback = Playback((0.0,), (1.0,), 0)
    playback.feed([(10.0,), (20.0,)])
    while playback.next() is not None:
        pass
    assert playback.cause is Cause.UNDER_RUN
    assert playback.abrupt


def test_a_deadline_does_not_move_with_the_one_before_but_a_lost_cycle_is_not_made_good() -> None:
    pace = Pace(0.01, 1.0)
    pace.begun(1.004)
    assert pace.due == pytest.approx(1.01)
    pace.begun(1.035)
    assert pace.due == pytest.approx(1.045)
    assert (pace.met, pace.slips) == (2, 1)
    assert pace.lateness.longest == pytest.approx(0.025)


def test_shares_of_lateness_are_right_to_a_twentieth() -> None:
    lateness = Lateness()
    for microseconds in range(1, 1001):
        lateness.add(microseconds * 1e-6)
    assert lateness.share(0.5) == pytest.approx(500e-6, rel=0.05)
    assert lateness.share(0.99) == pytest.approx(990e-6, rel=0.05)
    assert lateness.share(1.0) == pytest.approx(1000e-6)
    assert Lateness().share(0.5) == 0.0


def test_messages_come_back_whole_however_they_are_cut() -> None:
    plan = CyclePlan(0.01, (1.5, -2.0), (Track(0x200, b"\x0f\x00", 3.5, 4.25), Track(0x201, b"", 1.0)), 7, 90)
    way = Beside("socketcand", "can0", "127.0.0.1", 29536)
    assert messages.unpack_plan(messages.pack_plan(plan, way)) == (plan, way)
    rows = [(1.25, -3.0), (2.5, 1e6)]
    text = messages.pack_rows(rows) + messages.pack(messages.GO)
    inbox, taken = Inbox(), []
    for at in range(len(text)):
        taken += inbox.take(text[at : at + 1])
    assert [kind for kind, _ in taken] == [messages.ROWS, messages.GO]
    assert messages.unpack_rows(taken[0][1], 2) == rows


def test_a_report_comes_back_as_it_was() -> None:
    report = Report(Phase.STANDING, 3, 4, 1, Cause.ASKED, False, Lateness({5: 2}, 0.5), "why")
    told = messages.unpack_report(messages.pack_report(report, whole=True))
    assert (told.phase, told.cycles, told.taken, told.cause) == (Phase.STANDING, 3, 4, Cause.ASKED)
    assert told.lateness.counts == {5: 2}
    assert told.why == "why"


def test_a_row_is_a_controlword_and_a_target_for_each_axis() -> None:
    frames = row_frames((Track(0x501, b"\x0f\x00", 1.0),), (-2,))
    assert [(f.cob_id, f.data) for f in frames] == [(0x501, b"\x0f\x00\xfe\xff\xff\xff")]
