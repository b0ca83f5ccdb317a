"""Velocities that end by themselves, what was predicted of motions, and any schedule of second commands."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest
from stack_kit import AXES, Stack, stack_of, until

from drivers.cia402 import objects
from drivers.errors import AxisBusy, BadValue, CanaxisError, MotionFailed, MotionTimeout
from drivers.master import Axis, AxisConfig, HomeRequest, Motion, MotionState, MoveRequest, VelocityRequest
from drivers.master.plan.prediction import predict_home
from drivers.master.plan.requests import OnBusy

pytestmark = pytest.mark.looptime

ENDS: tuple[dict[str, Any], ...] = ({}, {"duration_s": 0.4}, {"travel": 3000}, {"held": True})


def place(stack: Stack, axis: int = 0) -> int:
    now = asyncio.get_running_loop().time()
    return stack.modules[1].module.axes[axis].read(objects.POSITION, 0, now) or 0


async def test_a_duration_counts_at_speed_and_ends_at_standstill(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    loop = asyncio.get_running_loop()
    motion = axis.run_at(VelocityRequest(-40_000, duration_s=2.0))
    await until(lambda: axis.status.velocity == -40_000)
    reached = loop.time()
    await until(lambda: (axis.status.velocity or 0) > -39_900)
    assert loop.time() - reached == pytest.approx(2.0, abs=0.03)
    assert motion.state is MotionState.RUNNING
    assert motion.progress == pytest.approx(2.4 / 2.8, abs=0.05)
    assert await motion.wait(5)
    assert (motion.state, axis.status.moving, axis.errand) == (MotionState.SUCCEEDED, False, None)
    assert motion.result is not None
    assert not motion.result["turning"]
    expected = motion.prediction
    assert expected is not None
    assert expected.end is not None
    assert place(stack) == pytest.approx(expected.end, abs=40_000 * 0.03)
    assert motion.started is not None


async def test_a_travel_is_exact_to_the_step(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    for velocity, travel in ((40_000, 12_345), (-40_000, 200), (900, 1), (-7, 3)):
        before = place(stack)
        motion = axis.run_at(VelocityRequest(velocity, travel=travel))
        assert await motion.wait(60)
        assert motion.state is MotionState.SUCCEEDED, motion.error
        assert place(stack) - before == (travel if velocity > 0 else -travel)


async def test_a_travel_begins_from_standstill_and_within_the_limits(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(40_000)).wait(10)
    with pytest.raises(AxisBusy, match="turning"):
        axis.run_at(VelocityRequest(40_000, travel=500))
    motion = axis.run_at(VelocityRequest(40_000, travel=500), on_busy=OnBusy.REPLACE)
    assert await motion.wait(20)
    assert motion.state is MotionState.SUCCEEDED
    with pytest.raises(BadValue):
        axis.run_at(VelocityRequest(40_000, travel=2**31 - 1))


async def test_a_velocity_that_is_held_lasts_until_somebody_stops_it(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.run_at(VelocityRequest(40_000, held=True))
    await asyncio.sleep(5)
    assert (motion.state, motion.progress) == (MotionState.RUNNING, None)
    await axis.stop("Its lease has ended.")
    assert motion.state is MotionState.CANCELLED
    assert "lease" in str(motion.error)


async def test_a_velocity_with_an_end_fails_where_the_axis_turns_no_more(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.run_at(VelocityRequest(900_000, acceleration=2_000_000, duration_s=60))
    assert await motion.wait(20), "a limit switch is in the way"
    assert motion.state is MotionState.FAILED
    assert isinstance(motion.error, MotionFailed)
    assert motion.progress is not None
    assert motion.progress < 0.5
    await until(lambda: axis.errand is None)
    assert not axis.status.moving


async def test_a_homing_s_deadline_is_what_was_predicted_of_it() -> None:
    limited = AxisConfig(name="x", soft_limits=(-50_000, 50_000))  # the switch is far beyond
    async with stack_of(1, axes=(limited, *AXES[1:])) as stack:
        axis = (await stack.enabled())[0]
        request = HomeRequest(method=18)
        longest = predict_home(limited, request)
        assert longest.duration_s == pytest.approx(100_000 / 25_600 + 0.5 + 54_400 / 5_120, abs=0.1)
        assert any("software limits" in sentence for sentence in longest.assumed)
        began = asyncio.get_running_loop().time()
        motion = axis.home(request)
        assert await motion.wait(60)
        assert isinstance(motion.error, MotionTimeout)
        lasted = asyncio.get_running_loop().time() - began
        assert lasted == pytest.approx(longest.duration_s * 1.25 + 3.0, abs=0.3)
        await until(lambda: axis.errand is None)
        assert not axis.status.moving


@pytest.mark.parametrize("seed", range(3))
async def test_any_schedule_ends_each_motion_once_and_begins_none_after_a_stop(
    stack: Stack, seed: int
) -> None:
    draw = random.Random(seed)
    axis = (await stack.enabled())[0]
    motions: list[Motion] = []
    ends: dict[str, int] = {}

    def count(motion: object) -> None:
        assert isinstance(motion, Motion)
        if motion.done:
            ends[motion.id] = ends.get(motion.id, 0) + 1

    def command(axis: Axis) -> Motion:
        on_busy = draw.choice(list(OnBusy))
        match draw.randrange(4):
            case 0:
                return axis.home(HomeRequest(method=35), on_busy=on_busy)
            case 1:
                end, velocity = draw.choice(ENDS), draw.choice((-30_000, 30_000))
                return axis.run_at(VelocityRequest(velocity, **end), on_busy=on_busy)
            case _:
                request = MoveRequest(draw.choice((-9000, 40, 20_000)), relative=draw.random() < 0.7)
                return axis.move_to(request, on_busy=on_busy)

    for _ in range(15):
        for _ in range(draw.randrange(1, 6)):
            await asyncio.sleep(draw.choice((0.0, 0.0, 0.001, 0.05, 0.4, 1.1)))
            try:
                motion = command(axis)
            except CanaxisError:
                continue
            motion.watch(count)
            motions.append(motion)
        if draw.random() < 0.3:
            await draw.choice(motions).cancel() if motions else None
        await axis.stop()
        rest, open_ones = place(stack), [motion for motion in motions if not motion.done]
        assert open_ones == []
        assert axis.queued == ()
        begun = [motion.started for motion in motions]
        await asyncio.sleep(0.3)
        assert place(stack) == rest
        assert [motion.started for motion in motions] == begun
    assert set(ends.values()) <= {1}
    assert any(motion.state is MotionState.SUCCEEDED for motion in motions)
