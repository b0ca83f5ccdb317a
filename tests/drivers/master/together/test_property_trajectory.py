"""Paths through points, and coming to rest on them, over random numbers."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cyclic.playback import Cause, Playback
from drivers.master.together.trajectory_path import Point, between, cycles, samples

places = st.floats(-1e5, 1e5)
speeds = st.floats(-1e5, 1e5)
gaps = st.floats(0.001, 2.0)


@st.composite
def paths(draw: st.DrawFn, *, smooth: bool) -> list[Point]:
    time, points = draw(st.floats(-10, 10)), []
    for _ in range(draw(st.integers(2, 6))):
        positions = (draw(places), draw(places))
        points.append(Point(time, positions, (draw(speeds), draw(speeds)) if smooth else None))
        time += draw(gaps)
    return points


@given(st.one_of(paths(smooth=True), paths(smooth=False)))
def test_the_path_passes_through_every_point(points: list[Point]) -> None:
    for first, second in itertools.pairwise(points):
        assert between(first, second, first.time) == pytest.approx(first.positions, abs=1e-6)
        assert between(first, second, second.time) == pytest.approx(second.positions, abs=1e-6)


@given(paths(smooth=True))
def test_with_velocities_it_has_no_corner(points: list[Point]) -> None:
    for first, middle, last in zip(points, points[1:], points[2:], strict=False):
        step = min(middle.time - first.time, last.time - middle.time) * 1e-4
        before = between(first, middle, middle.time - step)
        after = between(middle, last, middle.time + step)
        assert middle.velocities is not None
        for a, b, at, speed in zip(before, after, middle.positions, middle.velocities, strict=True):
            # the difference quotients go to the velocity as the step goes to 0; the bends bound how fast
            bend = 1e6 / step * 1e-4 + 1e6
            assert (at - a) / step == pytest.approx(speed, abs=bend)
            assert (b - at) / step == pytest.approx(speed, abs=bend)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-100, 100), st.floats(0.01, 1.0))
def test_a_parabola_is_met_everywhere(start: float, speed: float, bend: float, span: float) -> None:
    def way(t: float) -> float:
        return start + speed * t + bend * t * t

    first = Point(0.0, (way(0),), (speed,))
    last = Point(span, (way(span),), (speed + 2 * bend * span,))
    for share in (0.1, 0.25, 0.5, 0.9):
        assert between(first, last, share * span)[0] == pytest.approx(way(share * span), abs=1e-6)


@given(st.floats(0.02, 1.0), st.floats(-1e4, 1e4))
def test_the_error_of_a_cubic_is_bounded_by_the_fourth_derivative(span: float, jolt: float) -> None:
    def way(t: float) -> float:
        return jolt * t**4

    first = Point(0.0, (0.0,), (0.0,))
    last = Point(span, (way(span),), (4 * jolt * span**3,))
    bound = 24 * abs(jolt) * span**4 / 384  # of Hermite's interpolation
    for share in (0.2, 0.5, 0.8):
        assert abs(between(first, last, share * span)[0] - way(share * span)) <= bound * (1 + 1e-9) + 1e-9


@given(st.one_of(paths(smooth=True), paths(smooth=False)), st.floats(0.005, 0.1))
def test_the_set_points_begin_and_end_with_the_path_and_lie_on_it(points: list[Point], period: float) -> None:
    found = list(samples(points, period))
    duration = points[-1].time - points[0].time
    assert len(found) == cycles(duration, period)
    assert found[0].row == points[0].positions
    assert found[-1].row == points[-1].positions
    assert duration - 1e-6 <= found[-1].time < duration + period + 1e-6
    for number, sample in enumerate(found[:-1]):
        assert sample.time == pytest.approx(number * period)
        first, second = points[max(0, sample.point - 1)], points[max(1, sample.point)]
        assert sample.row == pytest.approx(between(first, second, points[0].time + sample.time), abs=1e-5)


@given(
    st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=60),
    st.floats(0.5, 5.0),
    st.integers(0, 60),
)
def test_coming_to_rest_stays_on_the_path_and_within_the_braking(
    bends: list[tuple[float, float]], braking: float, after: int
) -> None:
    """A path whose second difference is no more than the braking, stopped anywhere."""
    limit = min(braking, 3.0)
    rows, at, speed = [], [0.0, 0.0], [0.0, 0.0]
    for bend in bends:
        speed = [v + max(-limit, min(limit, b)) for v, b in zip(speed, bend, strict=True)]
        at = [p + v for p, v in zip(at, speed, strict=True)]
        rows.append(tuple(at))
    while any(speed):  # to rest
        speed = [v - max(-limit, min(limit, v)) for v in speed]
        at = [p + v for p, v in zip(at, speed, strict=True)]
        rows.append(tuple(at))
    playback = Playback((0.0, 0.0), (braking, braking), 0)
    playback.feed(rows)
    playback.finish()
    before, change, sent = (0.0, 0.0), (0.0, 0.0), 0
    while True:
        if sent == after:
            playback.brake(Cause.ASKED)
        if playback.next() is None:
            break
        here = tuple(playback._here)
        now = tuple(a - b for a, b in zip(here, before, strict=True))
        falls = [abs(a) - abs(b) for a, b in zip(change, now, strict=True)]
        assert max(falls) <= braking * 1.001 + 1e-6
        assert min(_distance(rows, here), _length(here)) <= 1e-6 * max(1.0, _length(here))
        before, change, sent = here, now, sent + 1
    assert max(abs(v) for v in change) <= braking * 1.001 + 1e-6
    assert not playback.abrupt


def _length(a: tuple[float, ...]) -> float:
    return max(abs(value) for value in a)


def _distance(rows: list[tuple[float, ...]], at: tuple[float, ...]) -> float:
    """From the polyline through the origin and the rows."""
    best = 1e18
    for first, second in zip([(0.0, 0.0), *rows], rows, strict=False):
        span = [b - a for a, b in zip(first, second, strict=True)]
        square = sum(s * s for s in span)
        share = 0.0
        if square:
            share = sum((p - a) * s for p, a, s in zip(at, first, span, strict=True)) / square
        share = max(0.0, min(1.0, share))
        best = min(best, _length(tuple(a + share * s - p for a, s, p in zip(first, span, at, strict=True))))
    return best
