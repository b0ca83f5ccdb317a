"""What becomes of a second command for an axis: refused, in the first one's place, or behind it."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import AXES, Stack, result_of, stack_of, until

from drivers.bus.frame import Frame
from drivers.cia402 import objects
from drivers.cia402.power import PowerState
from drivers.errors import AxisBusy, BadValue, LineFull, NotReady
from drivers.master import (
    Axis,
    AxisConfig,
    HomeRequest,
    Motion,
    MotionState,
    MoveRequest,
    VelocityRequest,
)
from drivers.master.axis.waiting_line import LONGEST
from drivers.master.plan.requests import OnBusy

pytestmark = pytest.mark.looptime
REPLACE, QUEUE = OnBusy.REPLACE, OnBusy.QUEUE


def demand(stack: Stack, axis: int = 0) -> int:
    """Where the motor truly is."""
    now = asyncio.get_running_loop().time()
    return stack.modules[1].module.axes[axis].read(objects.POSITION, 0, now) or 0


def by(axis: Axis, steps: int, on_busy: OnBusy = QUEUE) -> Motion:
    return axis.move_to(MoveRequest(steps, relative=True), on_busy=on_busy)


async def ended(*motions: Motion) -> list[MotionState]:
    for motion in motions:
        assert await motion.wait(60)
    return [motion.state for motion in motions]


# --- queue


async def test_queued_moves_run_in_order_each_from_where_the_one_before_ended(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motions = [by(axis, 20_000), by(axis, -5_000), by(axis, 700)]
    assert axis.queued == tuple(motions[1:])
    assert [motion.state for motion in motions[1:]] == [MotionState.QUEUED] * 2
    assert [m.prediction.start for m in motions if m.prediction] == [0, 20_000, 15_000]
    await motions[0].wait(60)
    assert axis.motion is motions[1], "it begins in the moment in which the first one ends"
    assert await ended(*motions) == [MotionState.SUCCEEDED] * 3
    assert [m.result["position"] for m in motions if m.result] == [20_000, 15_000, 15_700]
    begun = [motion.started for motion in motions]
    assert begun == sorted(time for time in begun if time is not None)
    assert motions[2].evidence.tracks[axis.id].start == 15_000


async def test_nothing_else_is_begun_while_something_waits(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    by(axis, 20_000)
    by(axis, 1)
    with pytest.raises(AxisBusy):
        axis.move_to(MoveRequest(0))
    await axis.stop()


ENDS = {
    "stop": lambda axis: axis.stop(),
    "quick stop": lambda axis: axis.quick_stop(),
    "disable": lambda axis: axis.disable(),
    "cancel": lambda axis: axis.motion.cancel(),
}


async def test_whatever_ends_the_first_cancels_what_waits_and_nothing_of_it_begins(stack: Stack) -> None:
    for name, end in ENDS.items():
        axis = (await stack.enabled())[0]
        first, *others = [by(axis, 50_000), by(axis, 1000), axis.home(HomeRequest(method=35), on_busy=QUEUE)]
        await asyncio.sleep(0.7)
        await end(axis)
        rest = demand(stack)
        assert first.state is MotionState.CANCELLED, name
        for motion in others:
            assert (motion.state, motion.started) == (MotionState.CANCELLED, None), name
            assert motion.error is not None
            assert first.error is not None
            assert motion.error.message == first.error.message
        await asyncio.sleep(3)
        assert demand(stack) == rest, name
        assert axis.queued == ()
        assert axis.errand is None


async def test_a_latched_stop_cancels_what_waits_and_its_reset_begins_nothing(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    by(axis, 50_000)
    waiting = by(axis, 1000)
    await asyncio.sleep(0.7)
    await stack.network.stop_all("a test")
    assert waiting.state is MotionState.CANCELLED
    assert "a test" in str(waiting.error)
    stack.network.reset_stop()
    rest = demand(stack)
    await asyncio.sleep(3)
    assert demand(stack) == rest


async def test_a_fault_or_a_node_that_goes_cancels_what_waits(stack: Stack) -> None:
    axis, other, _ = await stack.enabled()
    first, second = by(axis, 50_000), by(axis, 1000)
    await asyncio.sleep(0.5)
    stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
    assert await ended(first, second) == [MotionState.FAILED, MotionState.CANCELLED]
    assert second.error is not None
    assert "FAULT" in second.error.message
    first, second = by(other, 50_000), by(other, 1000)
    await asyncio.sleep(0.5)
    stack.modules[1].power_off()
    assert await ended(first, second) == [MotionState.FAILED, MotionState.CANCELLED]


async def test_a_predecessor_that_fails_takes_the_others_along(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    first = axis.home(HomeRequest(method=18, timeout_s=1))
    second = axis.move_to(MoveRequest(5), on_busy=QUEUE)
    assert await ended(first, second) == [MotionState.FAILED, MotionState.CANCELLED]
    assert "before it failed" in str(second.error)
    assert second.started is None


async def test_one_that_waits_is_cancelled_by_itself_with_those_behind_it(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    first, second, third, fourth = (by(axis, 20_000), by(axis, 1), by(axis, 10), by(axis, 100))
    await asyncio.sleep(0.5)
    await third.cancel()
    assert axis.status.moving, "what runs isn't touched"
    assert [m.state for m in (third, fourth)] == [MotionState.CANCELLED] * 2
    assert axis.queued == (second,)
    assert await ended(first, second) == [MotionState.SUCCEEDED] * 2
    assert demand(stack) == 20_001


async def test_readiness_is_asked_anew_when_its_turn_comes() -> None:
    async with stack_of(1, axes=(AxisConfig(name="x", soft_limits=(-100_000, 1000)), *AXES[1:])) as stack:
        axis = (await stack.enabled())[0]
        first = axis.home(HomeRequest(method=17, fast=400_000, slow=40_000, acceleration=4_000_000))
        second = by(axis, 1_000_000)  # where it begins is known after the homing only
        third = by(axis, 5)
        assert second.prediction is None
        states = await ended(first, second, third)
        assert states == [MotionState.SUCCEEDED, MotionState.FAILED, MotionState.CANCELLED]
        assert isinstance(second.error, BadValue)
        with pytest.raises(BadValue):
            by(axis, 1_000_000)
        await until(lambda: axis.errand is None)
        by(axis, -50)
        with pytest.raises(BadValue):
            by(axis, 1_000_000)  # behind a move it is known at once


async def test_what_waits_behind_a_homing_is_not_begun_by_an_axis_that_lost_its_power_meanwhile(
    stack: Stack,
) -> None:
    axis = (await stack.enabled())[0]
    first = axis.home(HomeRequest(method=35))  # which needs none
    second, third = by(axis, 500), by(axis, 5)
    await until(lambda: first.started is not None)
    stack.wire.inject(Frame(axis.pdos.power.cob_id, b"\x06\x00\x06"))  # another master
    assert await ended(first, second, third) == [
        MotionState.SUCCEEDED,
        MotionState.FAILED,
        MotionState.CANCELLED,
    ]
    assert isinstance(second.error, NotReady)
    assert [obstacle.code for obstacle in second.error.obstacles] == ["not_enabled"]
    assert second.started is None


async def test_an_absolute_move_may_wait_for_the_homing_that_it_needs() -> None:
    async with stack_of(1, axes=(AxisConfig(name="x", require_homing=True), *AXES[1:])) as stack:
        axis = (await stack.enabled())[0]
        with pytest.raises(NotReady, match="not homed"):
            axis.move_to(MoveRequest(5), on_busy=QUEUE)
        motions = [axis.home(HomeRequest(method=35)), axis.move_to(MoveRequest(5), on_busy=QUEUE)]
        assert await ended(*motions) == [MotionState.SUCCEEDED] * 2


async def test_nothing_waits_behind_what_has_no_end(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.run_at(VelocityRequest(40_000))
    with pytest.raises(AxisBusy, match="nothing can come after it"):
        by(axis, 5)
    with pytest.raises(AxisBusy):
        axis.run_at(VelocityRequest(5), on_busy=QUEUE)
    await until(lambda: axis.errand is None)
    with pytest.raises(AxisBusy, match="turning"):
        by(axis, 5)
    await axis.stop()
    stopping = asyncio.create_task(axis.stop())
    by(axis, 50_000)
    stopping.cancel()
    await asyncio.sleep(0.5)
    axis.begin_stop("test")
    with pytest.raises(AxisBusy, match="stopped"):
        by(axis, 5)
    with pytest.raises(AxisBusy, match="stopped"):
        by(axis, 5, REPLACE)


async def test_a_full_line_says_when_there_will_be_room(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    by(axis, 500_000)
    for _ in range(LONGEST):
        by(axis, 1)
    with pytest.raises(LineFull) as full:
        by(axis, 1)
    assert full.value.frees_in_s == pytest.approx(10, rel=0.2)
    await axis.stop()
    assert axis.queued == ()


# --- replace


async def test_a_replaced_move_ramps_down_and_nothing_of_it_happens_afterwards(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    for instant in (0.0, 0.0004, 0.0021, 0.02, 0.6, 1.4):
        first, waiting = by(axis, 90_000), by(axis, 10)
        await asyncio.sleep(instant)
        second = axis.move_to(MoveRequest(-3_000), on_busy=REPLACE)
        for motion in (first, waiting):
            assert motion.state is MotionState.CANCELLED
            assert "Another command replaced it" in str(motion.error)
        assert second.state is MotionState.QUEUED
        assert axis.queued == (second,)
        assert await ended(second) == [MotionState.SUCCEEDED], (instant, second.error)
        assert demand(stack) == -3_000
        await asyncio.sleep(1)
        assert demand(stack) == -3_000
        assert waiting.started is None


async def test_the_last_of_several_replacements_wins_and_a_queue_goes_behind_it(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    first = by(axis, 90_000)
    await asyncio.sleep(0.8)
    second = axis.move_to(MoveRequest(1), on_busy=REPLACE)
    third = axis.home(HomeRequest(method=35), on_busy=REPLACE)
    fourth = by(axis, 40)
    assert [m.state for m in (first, second)] == [MotionState.CANCELLED] * 2
    assert await ended(third, fourth) == [MotionState.SUCCEEDED] * 2
    assert demand(stack) == 40
    assert second.started is None


async def test_a_stop_in_the_ramp_of_a_replacement_ends_that_too(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    for how in (axis.stop, axis.quick_stop, axis.disable):
        await axis.enable()
        by(axis, 90_000)
        await asyncio.sleep(0.8)
        second = axis.move_to(MoveRequest(0), on_busy=REPLACE)
        third = by(axis, 5)
        await asyncio.sleep(0.1)
        assert axis.making_way
        await how()
        assert not axis.status.moving
        rest = demand(stack)
        assert [(m.state, m.started) for m in (second, third)] == [(MotionState.CANCELLED, None)] * 2
        await asyncio.sleep(2)
        assert demand(stack) == rest


async def test_cancelling_the_replacement_leaves_the_axis_standing(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    by(axis, 90_000)
    await asyncio.sleep(0.8)
    second = axis.move_to(MoveRequest(0), on_busy=REPLACE)
    await second.cancel()
    assert second.state is MotionState.CANCELLED
    assert not axis.status.moving
    rest = demand(stack)
    await asyncio.sleep(2)
    assert demand(stack) == rest


@pytest.mark.parametrize("trouble", ["a fault", "another master's disable"])
async def test_a_replacement_is_not_begun_by_an_axis_that_may_not_move_any_more(
    stack: Stack, trouble: str
) -> None:
    axis = (await stack.enabled())[0]
    by(axis, 90_000)
    await asyncio.sleep(0.8)
    second = axis.move_to(MoveRequest(0), on_busy=REPLACE)
    third = by(axis, 5)
    await asyncio.sleep(0.1)
    assert axis.making_way
    sent: list[Frame] = []
    if trouble == "a fault":
        stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
    else:
        stack.wire.inject(Frame(axis.pdos.power.cob_id, b"\x06\x00\x01"))
    rpdos = {axis.pdos.power.cob_id, axis.pdos.position.cob_id}
    await until(lambda: axis.status.state is not PowerState.OPERATION_ENABLED)
    stack.wire.tap(lambda _, frame: sent.append(frame) if frame.cob_id in rpdos else None)
    assert await ended(second, third) == [MotionState.FAILED, MotionState.CANCELLED]
    assert isinstance(second.error, NotReady)
    assert {obstacle.code for obstacle in second.error.obstacles} >= {"not_enabled"}
    assert second.started is None
    assert sent == []
    await until(lambda: axis.errand is None)
    assert not axis.status.moving


async def test_a_replacement_stops_what_turns_freely_and_begins_from_standstill(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(40_000)).wait(10)
    move = by(axis, -1000, REPLACE)
    assert move.prediction is not None
    expected = move.prediction.end
    assert await ended(move) == [MotionState.SUCCEEDED]
    assert expected is not None
    assert abs(result_of(move)["position"] - expected) < 2_000
    await axis.disable()
    with pytest.raises(NotReady, match="switch_on_disabled"):
        by(axis, 5, REPLACE)
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED


async def test_one_velocity_goes_over_into_another_without_a_stop(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    slowest = 40_000
    await axis.run_at(VelocityRequest(40_000)).wait(10)

    def watch(_: object, __: object) -> None:
        nonlocal slowest
        slowest = min(slowest, abs(axis.status.velocity or 0))

    stack.wire.tap(watch)
    for on_busy in OnBusy:
        held = axis.run_at(VelocityRequest(60_000, held=True), on_busy=on_busy)
        await asyncio.sleep(0.5)
        assert held.state is MotionState.RUNNING
        with pytest.raises(AxisBusy):
            axis.run_at(VelocityRequest(40_000))
        back = axis.run_at(VelocityRequest(40_000), on_busy=REPLACE)
        assert held.state is MotionState.CANCELLED
        assert await ended(back) == [MotionState.SUCCEEDED]
    assert slowest >= 39_000
    await axis.stop()


async def test_no_velocity_goes_over_into_another_past_what_waits(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(50_000)).wait(10)
    slowing = axis.run_at(VelocityRequest(0))
    waiting = by(axis, -10_000)
    with pytest.raises(AxisBusy):
        axis.run_at(VelocityRequest(20_000))
    behind = axis.run_at(VelocityRequest(20_000), on_busy=QUEUE)
    assert axis.queued == (waiting, behind)
    assert await ended(slowing, waiting, behind) == [MotionState.SUCCEEDED] * 3
    assert axis.status.velocity == pytest.approx(20_000, rel=0.01)
    await axis.stop()
