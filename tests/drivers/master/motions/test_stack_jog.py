"""A jog turns while it is held and not longer, and never past a software limit: as the motor truly does."""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
from stack_kit import Stack, stack_of, until

from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia402.modes import Mode
from drivers.errors import AxisBusy, AxisFault, BadValue, NotReady
from drivers.master import (
    Axis,
    AxisConfig,
    Jog,
    JogEnd,
    JogRequest,
    MotionState,
    MoveRequest,
    Timing,
    VelocityRequest,
)
from drivers.sim.snapshot import AxisSnapshot, take

pytestmark = pytest.mark.looptime

SPEED, RATE = 50_000, 100_000
RAMP = SPEED / RATE
REQUEST = JogRequest(SPEED, RATE)
LATE = 0.05
"""Seconds that the halt and what tells of it may be under way."""


def now() -> float:
    return asyncio.get_running_loop().time()


def truly(stack: Stack, axis: int = 0) -> AxisSnapshot:
    """The axis as the module itself has it."""
    return take(1, stack.modules[1], ()).axes[axis]


async def held_for(jog: Jog, seconds: float, velocity: int = SPEED, each: float = 0.2) -> None:
    for pause in [each] * int(seconds / each) + [seconds % each]:
        jog.hold(velocity, now())
        await asyncio.sleep(pause)


async def turning(stack: Stack) -> tuple[Axis, Jog]:
    axis = (await stack.enabled())[0]
    jog = axis.jog(REQUEST, held_at=now())
    await held_for(jog, 1.0)
    assert truly(stack).velocity == SPEED
    return axis, jog


async def test_it_turns_while_it_is_held_and_a_release_ramps_down(stack: Stack) -> None:
    axis, jog = await turning(stack)
    assert (axis.motion, jog.state, axis.errand) == (jog, MotionState.RUNNING, "being jogged")
    released = now()
    jog.end(JogEnd.RELEASED)
    await until(lambda: not truly(stack).moving)
    assert now() - released <= RAMP + LATE
    await jog.wait(5)
    assert jog.state is MotionState.SUCCEEDED
    assert axis.status.mode is Mode.NO_MODE
    assert axis.errand is None
    assert jog.result is not None
    rest = truly(stack).place
    assert jog.result["position"] == jog.result["travelled"] == rest > SPEED / 2
    assert jog.result["end"] == "released"
    assert jog.result["longest_gap_ms"] == pytest.approx(200)
    await asyncio.sleep(2)
    assert truly(stack).place == rest, "a released halt takes nothing up again"


async def test_who_holds_once_and_is_silent_is_not_turned_for_longer_than_the_silence_allows(
    stack: Stack,
) -> None:
    axis = (await stack.enabled())[0]
    begun = now()
    jog = axis.jog(REQUEST, held_at=begun)
    await until(lambda: truly(stack).moving)
    await until(lambda: not truly(stack).moving)
    assert now() - begun <= REQUEST.silence_s + RAMP + LATE
    await jog.wait(5)
    assert jog.over is JogEnd.SILENCE


async def test_silence_stops_it_and_later_holds_do_not_revive_it(stack: Stack) -> None:
    axis, jog = await turning(stack)
    jog.hold(SPEED, last := now())
    await until(lambda: not truly(stack).moving)
    assert REQUEST.silence_s < now() - last <= REQUEST.silence_s + RAMP + LATE
    jog.hold(SPEED, now())
    await jog.wait(5)
    assert jog.state is MotionState.CANCELLED
    assert jog.error is not None
    assert "No hold came" in jog.error.message
    assert jog.result is not None
    assert jog.result["end"] == "silence"
    jog.hold(SPEED, now())
    await asyncio.sleep(1)
    assert not truly(stack).moving
    assert (await axis.move_to(MoveRequest(10, relative=True)).wait(10)) is True


@pytest.mark.parametrize("end", [JogEnd.CLOSED, JogEnd.LEASE])
async def test_an_end_that_nobody_wanted_is_a_cancelled_jog(stack: Stack, end: JogEnd) -> None:
    _, jog = await turning(stack)
    jog.end(end)
    jog.end(JogEnd.RELEASED)
    await jog.wait(5)
    assert jog.state is MotionState.CANCELLED
    assert jog.result is not None
    assert jog.result["end"] == end.value
    assert not truly(stack).moving


@pytest.mark.parametrize("seconds", [0.0, 0.001, 0.003, 0.008, 0.02])
async def test_a_release_before_the_drive_is_ready_turns_nothing(stack: Stack, seconds: float) -> None:
    axis = (await stack.enabled())[0]
    jog = axis.jog(REQUEST, held_at=now())
    await asyncio.sleep(seconds)
    jog.end(JogEnd.RELEASED)
    await jog.wait(5)
    assert jog.state is MotionState.SUCCEEDED, jog.error
    assert abs(truly(stack).place) <= RATE * (seconds + LATE) ** 2
    assert not truly(stack).moving
    assert axis.errand is None


async def test_speed_and_direction_follow_the_holds(stack: Stack) -> None:
    _, jog = await turning(stack)
    await held_for(jog, 1.5, -20_000)
    assert truly(stack).velocity == -20_000
    await held_for(jog, 0.5, 0)
    assert truly(stack).velocity == 0
    assert jog.held, "held still, at no speed"
    jog.end(JogEnd.RELEASED)
    await jog.wait(5)


async def test_a_hold_above_the_axis_s_maximum_counts_as_that(stack: Stack) -> None:
    axis, jog = await turning(stack)
    axis.go_by(replace(axis.config, max_velocity=axis.config.velocity))
    jog.hold(10 * axis.config.velocity, now())
    assert jog.velocity == axis.config.velocity
    jog.hold(-10 * axis.config.velocity, now())
    assert jog.velocity == -axis.config.velocity


async def test_anybody_s_stop_ends_it(stack: Stack) -> None:
    axis, jog = await turning(stack)
    stop = asyncio.create_task(axis.stop())
    await held_for(jog, RAMP + LATE)
    assert not truly(stack).moving, "holding on doesn't help"
    await stop
    assert jog.state is MotionState.CANCELLED
    assert jog.result is not None
    assert "end" not in jog.result


async def test_a_fault_ends_it(stack: Stack) -> None:
    _, jog = await turning(stack)
    stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
    await jog.wait(5)
    assert jog.state is MotionState.FAILED
    assert isinstance(jog.error, AxisFault)
    await until(lambda: not truly(stack).moving)


async def test_a_lost_module_fails_it(stack: Stack) -> None:
    _, jog = await turning(stack)
    stack.modules[1].power_off()
    await held_for(jog, 3.0)
    assert jog.state is MotionState.FAILED


async def test_one_jog_an_axis_and_none_on_one_that_does_something_else(stack: Stack) -> None:
    x, y, z = await stack.enabled()
    jog = x.jog(REQUEST, held_at=now())
    with pytest.raises(AxisBusy):
        x.jog(REQUEST, held_at=now())
    with pytest.raises(AxisBusy):
        x.run_at(VelocityRequest(1000))
    y.move_to(MoveRequest(100_000))
    with pytest.raises(AxisBusy):
        y.jog(REQUEST, held_at=now())
    await z.run_at(VelocityRequest(1000)).wait(5)
    with pytest.raises(AxisBusy):
        z.jog(REQUEST, held_at=now())
    jog.end(JogEnd.RELEASED)
    await asyncio.gather(jog.wait(5), y.stop(), z.stop())


async def test_it_needs_an_enabled_axis(stack: Stack) -> None:
    with pytest.raises(NotReady):
        stack.axes[0].jog(REQUEST, held_at=now())


async def test_the_axis_stays_within_its_limits_whatever_is_held() -> None:
    rng = random.Random(7)
    low, high = -20_000, 30_000
    axes = (AxisConfig(name="x", soft_limits=(low, high), switch_parameters=3),)
    async with stack_of(1, axes=axes) as stack:
        await stack.ready()
        axis = stack.axes[0]
        await axis.enable()
        direction = 1
        for _ in range(6):
            speed, rate = round(10 ** rng.uniform(4, 5.5)) * direction, round(10 ** rng.uniform(4.5, 6.3))
            jog = axis.jog(JogRequest(speed, rate), held_at=now())
            while not jog.done:
                jog.hold(speed, now())
                await asyncio.sleep(0.2)
            assert jog.over is JogEnd.LIMIT, (speed, rate, jog.error)
            assert jog.state is MotionState.SUCCEEDED
            short = high - truly(stack).place if direction > 0 else truly(stack).place - low
            assert 0 <= short <= 20, (speed, rate)
            assert truly(stack).state == "operation_enabled"
            with pytest.raises(BadValue):
                axis.jog(JogRequest((high - low) * direction, rate), held_at=now())
            direction = -direction


LIMIT = 60_000


@asynccontextmanager
async def between_limits() -> AsyncIterator[Stack]:
    """A module whose first axis is enabled at 0, in the middle between its software limits."""
    axes = (AxisConfig(name="x", soft_limits=(-LIMIT, LIMIT), switch_parameters=3),)
    async with stack_of(1, axes=axes) as stack:
        await stack.ready()
        await stack.axes[0].enable()
        yield stack


async def press_to_the_end(stack: Stack, velocity: int, rate: int) -> JogEnd | None:
    """Hold until the jog is over by itself; why it was."""
    jog = stack.axes[0].jog(JogRequest(velocity, rate), held_at=now())
    while not jog.done:
        jog.hold(velocity, now())
        await asyncio.sleep(0.2)
    await stack.axes[0].stop()
    return jog.over


def rarely(stack: Stack, seconds: float) -> None:
    """Let the axis's position through to the master every so often only: it grows that old in between."""
    position, last = stack.axes[0].pdos.motion.cob_id, -math.inf

    def lost(frame: Frame) -> bool:
        nonlocal last
        if frame.cob_id != position:
            return False
        if now() - last < seconds:
            return True
        last = now()
        return False

    stack.wire.faults.drop(lost)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(
    ("each", "speed", "rate"), [(0.13, 50_000, 400_000), (0.3, 30_000, 100_000), (0.45, 100_000, 100_000)]
)
async def test_the_limit_holds_though_positions_come_rarely(
    direction: int, each: float, speed: int, rate: int
) -> None:
    async with between_limits() as stack:
        rarely(stack, each)
        assert await press_to_the_end(stack, direction * speed, rate) is JogEnd.LIMIT
        assert LIMIT // 2 < direction * truly(stack).place <= LIMIT


@pytest.mark.parametrize("direction", [1, -1])
async def test_the_limit_holds_though_frames_take_their_longest_both_ways(direction: int) -> None:
    async with between_limits() as stack:
        pdos = stack.axes[0].pdos
        stack.wire.faults.delay(cob_id(pdos.motion.cob_id, pdos.velocity.cob_id), Timing().flight)
        assert await press_to_the_end(stack, direction * 200_000, 1_000_000) is JogEnd.LIMIT
        assert 0.9 * LIMIT < direction * truly(stack).place <= LIMIT
