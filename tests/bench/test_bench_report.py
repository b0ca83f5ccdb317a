"""The benchmark's frame: ratios are taken round by round, and goals are judged by the median."""

from __future__ import annotations

import pytest

from bench.report import Goal, Row, Spread, table


def test_a_ratio_is_taken_in_each_round_not_between_the_medians():
    row = Row.beside("x", "us", ours=[1.0, 20.0, 3.0], peer=[2.0, 10.0, 3.0], against="canopen")
    assert row.ratio == Spread(0.5, 1.0, 2.0)
    assert row.ours == Spread(1.0, 3.0, 20.0)


def test_rounds_of_different_length_are_refused():
    with pytest.raises(ValueError, match="zip"):
        Row.beside("x", "us", ours=[1.0], peer=[1.0, 2.0], against="canopen")


@pytest.mark.parametrize(
    ("goal", "met"), [(Goal(0.5), True), (Goal(0.4), False), (Goal(0.5, at_least=True), True), (None, None)]
)
def test_the_median_ratio_is_held_against_the_goal(goal: Goal | None, met: bool | None):
    assert Row.beside("x", "us", [5.0, 1.0, 90.0], [10.0] * 3, "canopen", goal).met is met


def test_without_a_peer_the_figure_itself_is_held_against_the_goal():
    assert Row.alone("lost", "frames", [0, 0, 1], Goal(0)).met
    assert not Row.alone("lost", "frames", [0, 1, 1], Goal(0)).met


def test_the_table_says_what_was_missed():
    text = table(
        [Row.beside("read", "us", [30.0], [40.0], "canopen", Goal(0.5)), Row.alone("n", "1/s", [12345])]
    )
    lines = text.splitlines()
    assert len({len(line) for line in lines}) == 1
    assert [cell.strip() for cell in lines[2].split("|")[1:-1]] == [
        "read", "us", "30 / 30 / 30", "40 / 40 / 40", "canopen", "0.75 / 0.75 / 0.75", "<= 0.5", "NO"
    ]  # fmt: skip
    assert "12,345" in lines[3]
