"""Any schedule of lost, doubled, late and swapped frames: the invariants hold, and nothing hangs."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from stack_kit import Stack, stack_of, until
from virtual_clock import virtual_loop

from drivers.bus.faults import cob_id
from drivers.cia402 import objects
from drivers.cia402.power import Controlword
from drivers.errors import CanaxisError
from drivers.master import HomeRequest, Motion, MotionState, MoveRequest, NodeState, VelocityRequest

PHASES = (Phase.explicit, Phase.reuse, Phase.generate)
"""Shrinking would take minutes: a failure names its schedule, which is short already."""
LONGEST = 60.0
"""Seconds in which every command of these tests has ended, one way or another, whatever is lost."""
PLACES = {
    "power": 0x201,
    "set point": 0x301,
    "velocity": 0x401,
    "status": 0x181,
    "position": 0x281,
    "request": 0x601,
    "answer": 0x581,
    "its heartbeat": 0x701,
    "our heartbeat": 0x77F,
    "NMT": 0x000,
    "status of the next axis": 0x1FE,
}


@dataclass(frozen=True)
class Trouble:
    """What happens to `count` frames of one identifier, `after` so many seconds."""

    after: float
    kind: str
    place: str
    count: int


@dataclass(frozen=True)
class Step:
    """A command for axis 0, stopped after so many seconds if it has not ended."""

    kind: str
    value: int
    stop_after: float | None


troubles = st.lists(
    st.builds(
        Trouble,
        st.sampled_from([0.0, 0.001, 0.01, 0.1, 0.4]),
        st.sampled_from(["drop", "duplicate", "delay", "long delay", "reorder"]),
        st.sampled_from(sorted(PLACES)),
        st.integers(1, 5),
    ),
    max_size=4,
)
steps = st.lists(
    st.tuples(
        st.builds(
            Step,
            st.sampled_from(["move", "velocity", "home"]),
            st.sampled_from([-9_000, -1, 0, 40, 12_000]),
            st.sampled_from([None, 0.0, 0.0006, 0.004, 0.03, 0.3]),
        ),
        troubles,
    ),
    min_size=1,
    max_size=4,
)


def held(stack: Stack, index: int, axis: int = 0) -> int:
    """An object as the simulated module holds it."""
    module = stack.modules[1].module
    live = module.axes[axis].read(index, 0, asyncio.get_running_loop().time())
    return module.dictionary.stored(module.profile.spec(index, 0, axis).address) if live is None else live


def begin(stack: Stack, step: Step) -> Motion:
    axis = stack.axes[0]
    match step.kind:
        case "move":
            return axis.move_to(MoveRequest(step.value))
        case "velocity":
            return axis.run_at(VelocityRequest(step.value))
        case _:
            return axis.home(HomeRequest(method=35))


def apply(stack: Stack, trouble: Trouble) -> None:
    faults, where = stack.wire.faults, cob_id(PLACES[trouble.place])
    match trouble.kind:
        case "drop":
            faults.drop(where, trouble.count)
        case "duplicate":
            faults.duplicate(where, trouble.count)
        case "reorder":
            faults.reorder(where, 2 * trouble.count)
        case kind:
            faults.delay(where, 0.002 if kind == "delay" else 0.28, trouble.count)


async def usable(stack: Stack) -> None:
    """What a careful user does before the next command."""
    axis = stack.axes[0]
    for _ in range(20):
        try:
            await until(lambda: stack.node.state is NodeState.OPERATIONAL and not axis.status.stale, LONGEST)
            await axis.stop()
            await axis.reset_fault()
            await axis.enable()
        except CanaxisError:
            await asyncio.sleep(0.5)
        else:
            return
    raise AssertionError(f"the axis did not come back: {stack.node.status()}")


async def stays(stack: Stack, what: str) -> None:
    rest = held(stack, objects.POSITION)
    await asyncio.sleep(0.7)
    assert held(stack, objects.POSITION) == rest, f"it moved after {what}"


async def carry_out(stack: Stack, step: Step, schedule: list[Trouble]) -> None:
    axis = stack.axes[0]
    loop = asyncio.get_running_loop()
    timers = [loop.call_later(trouble.after, apply, stack, trouble) for trouble in schedule]
    try:
        motion = begin(stack, step)
    except CanaxisError:
        pass
    else:
        ended = await motion.wait(LONGEST if step.stop_after is None else step.stop_after)
        if motion.state is MotionState.SUCCEEDED and step.kind == "move":
            assert held(stack, objects.POSITION) == step.value
            assert axis.status.position == step.value
        if step.stop_after is None:
            assert ended, "the motion hangs"
        try:
            await axis.stop()
        except CanaxisError:
            pass
        else:
            assert motion.done
            assert not held(stack, objects.CONTROLWORD) & Controlword.NEW_SET_POINT
            await stays(stack, f"a stop of {step}")
    for timer in timers:
        timer.cancel()
    stack.wire.faults.clear()


async def play(program: list[tuple[Step, list[Trouble]]]) -> None:
    async with stack_of(1) as stack:
        await stack.enabled()
        await stack.axes[1].move_to(MoveRequest(111)).wait(20)
        for step, schedule in program:
            async with asyncio.timeout(3 * LONGEST):
                await usable(stack)
                await carry_out(stack, step, schedule)
        async with asyncio.timeout(3 * LONGEST):
            await usable(stack)
        await stack.axes[0].stop()
        assert not held(stack, objects.CONTROLWORD) & Controlword.NEW_SET_POINT
        assert [axis.status.position for axis in stack.axes[1:]] == [111, 0]
        assert stack.axes[0].status.position == held(stack, objects.POSITION)
        assert stack.network.failure is None


@settings(max_examples=12, deadline=None, phases=PHASES, suppress_health_check=[HealthCheck.too_slow])
@given(steps)
def test_the_invariants_hold_under_any_schedule_of_faults(program: list[tuple[Step, list[Trouble]]]) -> None:
    with asyncio.Runner(loop_factory=virtual_loop) as runner:
        runner.run(play(program))
