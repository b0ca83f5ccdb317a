"""An axis that is woken seldom ends exactly where one ends that is woken often, with the same emergencies."""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia301.emcy import Emergency
from drivers.sim.motion.axis import SimulatedAxis
from drivers.sim.motion.travel import AxisSettings

TRAVEL = AxisSettings(
    travel_min=-60_000,
    travel_max=60_000,
    negative_limit=-50_000,
    positive_limit=50_000,
    home=(5_000, 6_000),
    index_pitch=3_200,
    index_phase=100,
)
LIVE = (0x6041, 0x6061, 0x6062, 0x6064, 0x606C, 0x60FD, 0x2101, 0x2102)
PARAMETERS = {
    (0x2000, 0): 8,
    (0x2001, 0): 200,
    (0x2002, 1): 20,
    (0x2002, 2): 30,
    (0x200A, 0): 10,
    (0x200B, 3): 1,
    (0x2010, 0): 5,
    (0x2015, 0): 1000,
    (0x208C, 0): 181,
    (0x605A, 0): 6,
    (0x6067, 0): 50,
    (0x6068, 0): 25,
    (0x606A, 0): -1,
    (0x607D, 1): -(2**31),
    (0x607D, 2): 2**31 - 1,
    (0x6081, 0): 20_000,
    (0x6082, 0): 10,
    (0x6083, 0): 40_000,
    (0x6084, 0): 30_000,
    (0x6085, 0): 100_000,
    (0x608F, 1): 40_000,
    (0x6098, 0): 19,
    (0x6099, 1): 20_000,
    (0x6099, 2): 2_000,
    (0x609A, 0): 50_000,
    (0x60C2, 1): 10,
    (0x60C2, 2): -3,
}


class Stored:
    def __init__(self, encoder: bool) -> None:
        self.values = PARAMETERS | ({(0x606A, 0): 0, (0x6065, 0): 700} if encoder else {})

    def get(self, base_index: int, sub: int = 0) -> int:
        return self.values.get((base_index, sub), 0)

    def set(self, base_index: int, sub: int, value: int) -> None:
        self.values[base_index, sub] = value


Action = Callable[[SimulatedAxis, Stored, float], None]


def write(index: int, value: int, sub: int = 0) -> Action:
    def act(axis: SimulatedAxis, stored: Stored, now: float) -> None:
        if axis.may_write(index, sub, value, now) is None:
            stored.set(index, sub, value)
            axis.written(index, sub, value, now)

    return act


def together(*actions: Action) -> Action:
    def act(axis: SimulatedAxis, stored: Stored, now: float) -> None:
        for action in actions:
            action(axis, stored, now)

    return act


ENABLE = together(*(write(0x6040, word) for word in (0x80, 0x00, 0x06, 0x07, 0x0F)))
ACTIONS: st.SearchStrategy[Action] = st.one_of(
    st.just(ENABLE),
    st.just(ENABLE),
    st.sampled_from((0, 1, 1, 3, 3, 6, 6, 8, 9)).map(lambda mode: write(0x6060, mode)),
    st.sampled_from((0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x5F, 0x10F, 0x80)).map(
        lambda word: write(0x6040, word)
    ),
    st.integers(-80_000, 80_000).map(
        lambda target: together(write(0x607A, target), write(0x6040, 0x0F), write(0x6040, 0x1F))
    ),
    st.integers(-30_000, 30_000).map(lambda velocity: write(0x60FF, velocity)),
    st.sampled_from((1, 2, 3, 5, 17, 18, 19, 21, 33, 34, 35)).map(
        lambda method: together(
            write(0x6060, 6), write(0x6098, method), ENABLE, write(0x6040, 0x0F), write(0x6040, 0x1F)
        )
    ),
    st.just(lambda axis, _, now: axis.press_switch("home", now)),
    st.just(lambda axis, _, now: axis.release_switch("home", now)),
    st.just(lambda axis, _, now: axis.press_switch("positive", now)),
    st.just(lambda axis, _, now: axis.release_switch("positive", now)),
    st.just(lambda axis, _, now: axis.block(now)),
    st.just(lambda axis, _, now: axis.unblock(now)),
    st.just(lambda axis, _, now: axis.sync(now)),
    st.just(write(0x20A4, 15_000)),
    st.integers(0, 40_000).map(lambda limit: together(write(0x607D, -limit, 1), write(0x607D, limit, 2))),
)


class Run:
    def __init__(self, encoder: bool) -> None:
        self.stored = Stored(encoder)
        self.heard: list[Emergency] = []
        self.axis = SimulatedAxis(2, self.stored, TRAVEL, self.heard.append)
        self.axis.reset(0.0)

    def snapshot(self, now: float) -> tuple[int | None, ...]:
        return tuple(self.axis.read(index, 0, now) for index in LIVE)


@settings(max_examples=150, deadline=None)
@given(
    script=st.lists(st.tuples(st.floats(0.0, 8.0), ACTIONS, st.integers(1, 60)), max_size=14),
    encoder=st.booleans(),
)
def test_one_leap_and_many_small_steps_give_the_same(
    script: list[tuple[float, Action, int]], encoder: bool
) -> None:
    leaping, stepping = Run(encoder), Run(encoder)
    now = 0.0
    for wait, action, steps in [(0.0, ENABLE, 1), *script, (30.0, ENABLE, 50)]:
        for step in range(1, steps):
            stepping.axis.advance(now + wait * step / steps)
            stepping.snapshot(now + wait * step / steps)
        now += wait
        for run in (leaping, stepping):
            action(run.axis, run.stored, now)
        assert leaping.snapshot(now) == stepping.snapshot(now)
        assert leaping.heard == stepping.heard
        assert leaping.axis.next_event(now) == stepping.axis.next_event(now)


@settings(max_examples=100, deadline=None)
@given(script=st.lists(st.tuples(st.floats(0.0, 8.0), ACTIONS), max_size=12))
def test_whoever_wakes_the_axis_at_its_events_misses_nothing(script: list[tuple[float, Action]]) -> None:
    run = Run(encoder=False)
    now = 0.0
    for wait, action in [(0.0, ENABLE), *script]:
        end = now + wait
        while (event := run.axis.next_event(now)) is not None and event < end:
            discrete = run.axis.state, run.axis.mode
            assert event > now
            between = (now + event) / 2
            run.axis.advance(between)
            assert (run.axis.state, run.axis.mode) == discrete
            now = event
        now = end
        action(run.axis, run.stored, now)
