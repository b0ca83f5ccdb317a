"""Axes that move together: one SYNC starts them, they arrive together, and what ends one ends all."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest
from stack_kit import AXES, NeverAbove, Stack, position_of, result_of, stack_of, until

from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia301.cob import emcy
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.errors import AxisBusy, BadValue, NotReady
from drivers.master import AxisConfig, HomeRequest, MotionState, MoveRequest, VelocityRequest
from drivers.master.sdo.queue import Priority
from drivers.master.together.coordinated_move import CoordinatedMove
from drivers.sim.motion.goals import Goal
from drivers.sim.motion.motor import Motor
from drivers.sim.snapshot import take

pytestmark = pytest.mark.looptime

SYNC = 0x080
VSTART, VSTOP = Address(0x2010, 0), Address(0x6082, 0)
RPDO4 = (0x501, 0x500 + 126, 0x500 + 125)
"""Of the three axes of node 1."""


class Watch:
    """When each motor truly begins to turn and comes to rest, from the simulator itself."""

    def __init__(self, stack: Stack) -> None:
        self._legs: dict[tuple[int, int], list[tuple[float, float]]] = {}
        for node_id, node in stack.modules.items():
            for number, axis in enumerate(node.module.axes):
                self._legs[node_id, number] = []
                self._tap(axis.motor, self._legs[node_id, number])

    def _tap(self, motor: Motor, legs: list[tuple[float, float]]) -> None:
        pursue = motor.pursue

        def tapped(goal: Goal, now: float) -> None:
            pursue(goal, now)
            if motor.direction:
                legs.append((motor._leg.start, motor._leg.finish))

        motor.pursue = tapped

    def last(self, *axes: tuple[int, int]) -> tuple[list[float], list[float]]:
        """Starts and ends of the last leg of each."""
        legs = [self._legs[axis][-1] for axis in axes]
        return [leg[0] for leg in legs], [leg[1] for leg in legs]

    def turned(self, node_id: int, axis: int) -> bool:
        return bool(self._legs[node_id, axis])


def go(stack: Stack, *targets: int, node_id: int = 1, **options: Any) -> CoordinatedMove:
    axes = stack.network.nodes[node_id].axes
    return stack.network.move_together(
        [(axis, MoveRequest(target)) for axis, target in zip(axes, targets, strict=False)], **options
    )


async def at_rest(stack: Stack, group: CoordinatedMove) -> None:
    """The group has ended, once, and every motor stands and stays so."""
    assert await group.wait(60)
    modules = [node.module for node in stack.modules.values()]
    assert not any(axis.moving for module in modules for axis in module.axes)
    state = group.state
    axes = [stack.network.axis(each) for each in group.axes]
    where = [axis.status.position for axis in axes]
    stack.wire.inject(Frame(SYNC, b""))  # nothing waits for it any more
    await asyncio.sleep(1.5)
    assert not any(axis.moving for module in modules for axis in module.axes)
    assert [axis.status.position for axis in axes] == where
    assert group.state is state
    assert all(axis.motion is None for axis in axes)


FAST = tuple(
    AxisConfig(name=name, velocity=200_000, acceleration=900_000, deceleration=rate)
    for name, rate in (("x", 900_000), ("y", 600_000), ("z", 1_200_000))
)


async def test_each_axis_keeps_to_the_speed_that_was_asked_of_it() -> None:
    asked = 20_000
    async with stack_of(1, axes=FAST) as stack:
        x, y, _ = await stack.enabled()
        module = stack.modules[1]
        group = stack.network.move_together(
            [(x, MoveRequest(60_000, velocity=asked)), (y, MoveRequest(-30_000))]
        )
        fastest = 0.0
        while not group.done:
            fastest = max(fastest, abs(take(1, module, ()).axes[0].velocity))
            await asyncio.sleep(0.01)
        assert group.state is MotionState.SUCCEEDED, group.error
        assert asked * 0.99 <= fastest <= asked


async def test_random_targets_start_on_one_sync_and_arrive_within_ten_milliseconds() -> None:
    async with stack_of(1, axes=FAST) as stack:
        await random_moves(stack, 50)


async def random_moves(stack: Stack, times: int) -> None:
    axes = await stack.enabled()
    watch, dice = Watch(stack), random.Random(6)
    syncs: list[float] = []
    stack.wire.tap(lambda _, f: syncs.append(asyncio.get_running_loop().time()) if f.cob_id == SYNC else None)
    for _ in range(times):
        targets = [dice.randint(-60_000, 60_000) // dice.choice([1, 1, 10, 100]) for _ in axes]
        before = [position_of(axis) for axis in axes]
        group = go(stack, *targets)
        await group.wait(120)
        assert group.state is MotionState.SUCCEEDED, group.error
        assert [axis.status.position for axis in axes] == targets
        moved = [(1, n) for n in range(3) if before[n] != targets[n]]
        starts, ends = watch.last(*moved)
        assert len(set(starts)) == 1, "all on the same SYNC"
        assert starts[0] == pytest.approx(syncs[-1], abs=1e-9)
        shortest = min(abs(targets[n] - before[n]) for _, n in moved)
        assert group.coordination is not None
        if shortest >= 20 * group.coordination.duration_s:
            assert max(ends) - min(ends) < 0.010, (before, targets, group.result)
            assert result_of(group)["spread_s"] < 0.02
        assert ends[0] - starts[0] == pytest.approx(result_of(group)["predicted_s"], abs=0.01)
        for member, axis in zip(group.members, axes, strict=True):
            if member.profile is not None:
                assert member.profile.velocity <= axis.config.velocity
                assert member.profile.acceleration <= axis.config.acceleration


async def test_an_axis_without_a_way_takes_part_without_moving(stack: Stack) -> None:
    axes = await stack.enabled()
    group = go(stack, 20_000, 0, -5000)
    watch = Watch(stack)
    await until(lambda: group.state is MotionState.RUNNING)
    with pytest.raises(AxisBusy):
        axes[1].move_to(MoveRequest(1))
    assert all(axis.motion is group for axis in axes)
    await group.wait(30)
    assert group.state is MotionState.SUCCEEDED, group.error
    assert not watch.turned(1, 1)
    assert result_of(group)["axes"][1]["arrived_s"] is None
    again = go(stack, 20_000, 0, -5000)
    await again.wait(5)
    assert again.state is MotionState.SUCCEEDED
    assert result_of(again)["duration_s"] == 0


async def test_a_time_is_kept_and_relative_targets_count_from_where_the_axes_stand(stack: Stack) -> None:
    axes = await stack.enabled()
    await go(stack, 1000, 2000).wait(10)
    group = stack.network.move_together(
        [(axes[0], MoveRequest(500, relative=True)), (axes[1], MoveRequest(-4000, relative=True))],
        at_least=7.5,
    )
    await group.wait(20)
    assert [axis.status.position for axis in axes[:2]] == [1500, -2000]
    assert result_of(group)["duration_s"] == pytest.approx(7.5, abs=0.02)
    with pytest.raises(BadValue, match="1 step/s"):
        go(stack, 1501, -2001, at_least=100.0)


async def test_axes_of_two_nodes_start_on_one_sync() -> None:
    async with stack_of(1, 2) as stack:
        await stack.ready()
        first, second = stack.network.nodes[1].axes[0], stack.network.nodes[2].axes[2]
        await asyncio.gather(first.enable(), second.enable())
        watch = Watch(stack)
        group = stack.network.move_together([(first, MoveRequest(90_000)), (second, MoveRequest(-12_345))])
        await group.wait(30)
        assert group.state is MotionState.SUCCEEDED, group.error
        starts, ends = watch.last((1, 0), (2, 2))
        assert starts[0] == starts[1]
        assert abs(ends[0] - ends[1]) < 0.01


async def test_shapes_of_the_axes_do_not_bend_the_line_and_come_back() -> None:
    axes = (
        AxisConfig(name="x", start_velocity=2000, end_velocity=3000),
        AxisConfig(name="y", ramp_a1=20_000, ramp_v1=10_000, ramp_a2=40_000, ramp_v2=30_000),
        AXES[2],
    )
    async with stack_of(1, axes=axes) as stack:
        await stack.enabled()
        watch = Watch(stack)
        speeds = NeverAbove(stack, VSTART, VSTOP)
        group = go(stack, 100_000, 40_000, 2000)
        await group.wait(30)
        assert group.state is MotionState.SUCCEEDED, group.error
        starts, ends = watch.last((1, 0), (1, 1), (1, 2))
        assert len(set(starts)) == 1
        assert max(ends) - min(ends) < 0.01
        objects = stack.node.objects
        assert [
            await objects.read_int(objects.address(index, 0, axis), priority=Priority.CONTROL)
            for index, axis in ((0x2010, 0), (0x6082, 0), (0x2012, 1), (0x2017, 1))
        ] == [2000, 3000, 10_000, 30_000]
        assert (0, 10) in speeds.seen
        assert speeds.kept, speeds.seen


async def test_a_ramp_that_a_stopped_group_left_comes_back_in_order_with_the_next_move() -> None:
    async with stack_of(1, axes=(AxisConfig(name="x", start_velocity=2000, end_velocity=3000),)) as stack:
        axis = (await stack.enabled())[0]
        speeds = NeverAbove(stack, VSTART, VSTOP)
        group = go(stack, 100_000)
        await until(lambda: axis.status.moving)
        await group.cancel()
        assert speeds.seen[-1] == (0, 10)
        await axis.move_to(MoveRequest(0)).wait(30)
        assert speeds.seen[-1] == (2000, 3000)
        assert speeds.kept, speeds.seen


async def test_what_prevents_any_axis_prevents_all_and_each_is_named(stack: Stack) -> None:
    axes = await stack.enabled()
    await axes[1].disable()
    running = axes[2].move_to(MoveRequest(300_000))
    sent = stack.network.counters.sent
    with pytest.raises(NotReady) as refused:
        go(stack, 1, 2, 3)
    assert {(o.code, o.message.split(":")[0]) for o in refused.value.obstacles} == {
        ("not_enabled", "Node 1 axis 1"),
        ("busy", "Node 1 axis 2"),
    }
    assert stack.network.counters.sent == sent
    assert axes[0].errand is None
    assert not running.done
    with pytest.raises(BadValue, match="twice"):
        stack.network.move_together([(axes[0], MoveRequest(1)), (axes[0], MoveRequest(2))])


async def test_an_axis_that_must_be_homed_takes_part_by_a_relative_way_only() -> None:
    async with stack_of(1, axes=(AxisConfig(name="x", require_homing=True), *AXES[1:])) as stack:
        x, y, _ = await stack.enabled()
        watch = Watch(stack)
        with pytest.raises(NotReady, match="not homed"):
            go(stack, 1000, 2000)
        running = y.move_to(MoveRequest(90_000))
        with pytest.raises(NotReady, match="not homed"):
            go(stack, 1000, 2000, replace=True)
        await running.wait(30)
        assert running.state is MotionState.SUCCEEDED
        assert not watch.turned(1, 0)
        by_ways = [(x, MoveRequest(700, relative=True)), (y, MoveRequest(-500, relative=True))]
        assert await stack.network.move_together(by_ways).wait(30)
        assert [x.status.position, y.status.position] == [700, 89_500]
        await x.home(HomeRequest(method=35)).wait(30)
        group = go(stack, 1000, 2000)
        await group.wait(30)
        assert group.state is MotionState.SUCCEEDED, group.error


async def test_a_second_command_replaces_what_the_axes_do_if_it_says_so(stack: Stack) -> None:
    axes = await stack.enabled()
    running = axes[2].move_to(MoveRequest(300_000))
    turning = axes[0].run_at(VelocityRequest(20_000))
    await asyncio.sleep(0.8)
    with pytest.raises(AxisBusy):
        go(stack, 1, 2, 3)
    group = go(stack, 1000, 2000, 3000, replace=True)
    assert running.state is MotionState.CANCELLED
    await group.wait(60)
    assert group.state is MotionState.SUCCEEDED, group.error
    assert turning.state is MotionState.SUCCEEDED
    assert [axis.status.position for axis in axes] == [1000, 2000, 3000]
    first = go(stack, 300_000, 100_000, 50_000)
    await asyncio.sleep(0.5)
    second = go(stack, 0, 0, replace=True)
    await second.wait(60)
    assert first.state is MotionState.CANCELLED
    assert second.state is MotionState.SUCCEEDED, second.error


async def test_a_stop_while_axes_come_to_rest_for_the_group_ends_the_group(stack: Stack) -> None:
    axes = await stack.enabled()
    axes[2].move_to(MoveRequest(300_000))
    await asyncio.sleep(0.8)
    group = go(stack, 1000, 2000, 3000, replace=True)
    await axes[2].stop()
    await at_rest(stack, group)
    assert group.state is MotionState.CANCELLED
    assert axes[0].status.position == 0


@pytest.mark.parametrize(
    "seconds", [0.0, 0.0004, 0.0015, 0.003, 0.004, 0.0045, 0.005, 0.006, 0.008, 0.02, 0.4]
)
async def test_a_stop_of_one_axis_at_any_instant_stops_all(stack: Stack, seconds: float) -> None:
    axes = await stack.enabled()
    group = go(stack, 200_000, -100_000, 30_000)
    await asyncio.sleep(seconds)
    await axes[1].stop("A test stops it.")
    await at_rest(stack, group)
    assert group.state is MotionState.CANCELLED
    assert "axis y: A test stops it." in str(group.error)
    assert all(axis.status.state is PowerState.OPERATION_ENABLED for axis in axes)


@pytest.mark.parametrize("act", ["cancel", "quick_stop", "disable", "stop_all", "close"])
async def test_whatever_ends_one_ends_all(stack: Stack, act: str) -> None:
    axes = await stack.enabled()
    group = go(stack, 200_000, -100_000, 30_000)
    await asyncio.sleep(0.7)
    match act:
        case "cancel":
            await group.cancel()
            assert group.done
            assert not any(axis.status.moving for axis in axes)
        case "quick_stop":
            await axes[0].quick_stop()
            assert axes[0].status.state is PowerState.SWITCH_ON_DISABLED
        case "disable":
            await axes[0].disable()
            assert axes[0].status.state is PowerState.SWITCH_ON_DISABLED
        case "stop_all":
            report = await stack.network.stop_all("test")
            assert report.complete
        case _:
            await stack.network.close()
    await at_rest(stack, group)
    assert group.state is MotionState.CANCELLED


async def test_a_fault_of_one_axis_stops_the_others_at_once(stack: Stack) -> None:
    axes = await stack.enabled()
    group = go(stack, 200_000, -100_000, 30_000)
    await asyncio.sleep(0.7)
    stack.modules[1].apply(lambda module, now: module.axes[1].short("a", now))
    await until(lambda: axes[0].errand is not None and "stopped" in axes[0].errand, 0.05)
    await at_rest(stack, group)
    assert group.state is MotionState.FAILED
    assert group.error is not None
    assert group.error.code == "axis_fault"
    assert (group.error.node, group.error.axis) == (1, 1)
    assert axes[1].status.state is PowerState.FAULT
    assert position_of(axes[0]) < 100_000


async def test_an_emergency_that_comes_behind_the_fault_explains_it_and_holds_no_stop_up(
    stack: Stack,
) -> None:
    axes = await stack.enabled()
    group = go(stack, 200_000, -100_000, 30_000)
    await asyncio.sleep(0.7)
    stack.wire.faults.delay(cob_id(emcy(1)), 0.09)
    stack.modules[1].apply(lambda module, now: module.axes[1].short("a", now))
    await until(lambda: axes[0].errand is not None and "stopped" in axes[0].errand, 0.05)
    await at_rest(stack, group)
    assert group.error is not None
    assert group.error.code == "axis_fault"
    assert "2312" in group.error.message


async def test_a_limit_switch_of_one_axis_stops_the_others(stack: Stack) -> None:
    await stack.enabled()
    group = go(stack, 200_000, -100_000, 30_000)
    await asyncio.sleep(0.7)
    stack.modules[1].apply(lambda module, now: module.axes[1].press_switch("negative", now))
    await at_rest(stack, group)
    assert group.state is MotionState.FAILED
    assert "limit switch" in str(group.error)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("nth", [1, 2])
async def test_a_lost_rpdo_of_one_axis_starts_none_for_long(stack: Stack, axis: int, nth: int) -> None:
    axes = await stack.enabled()
    seen = 0

    def lost(frame: Frame) -> bool:
        nonlocal seen
        seen += frame.cob_id == RPDO4[axis]
        return frame.cob_id == RPDO4[axis] and seen == nth

    stack.wire.faults.drop(lost)
    group = go(stack, 200_000, -100_000, 30_000)
    await at_rest(stack, group)
    assert group.state is MotionState.FAILED
    assert group.error is not None
    assert group.error.axis == axis
    if nth == 1:
        assert [a.status.position for a in axes] == [0, 0, 0]
    await go(stack, 0, 0, 0).wait(30)
    again = go(stack, 5000, 100, -5000)
    await again.wait(30)
    assert again.state is MotionState.SUCCEEDED, again.error


@pytest.mark.parametrize("nth", [1, 2])
async def test_a_sync_that_one_node_does_not_hear_stops_the_other(nth: int) -> None:
    async with stack_of(1, 2) as stack:
        await stack.ready()
        pair = stack.network.nodes[1].axes[0], stack.network.nodes[2].axes[0]
        await asyncio.gather(*(axis.enable() for axis in pair))
        module = stack.modules[2].module
        receive, seen = module._receive.sync, 0

        def deaf(now: float) -> None:
            nonlocal seen
            seen += 1
            if seen != nth:
                receive(now)

        module._receive.sync = deaf
        group = stack.network.move_together([(pair[0], MoveRequest(90_000)), (pair[1], MoveRequest(9000))])
        await at_rest(stack, group)
        assert group.state is MotionState.FAILED
        assert group.error is not None
        assert group.error.node == 2
        assert pair[1].status.position == 0
        assert position_of(pair[0]) < 20_000


async def test_a_sync_of_another_master_in_between_is_noticed(stack: Stack) -> None:
    await stack.enabled()
    stack.wire.tap(
        lambda sender, f: (
            stack.wire.inject(Frame(SYNC, b""))
            if sender == "master" and f.cob_id == RPDO4[0] and f.data[0] & 0x10
            else None
        )
    )
    group = go(stack, 200_000, -100_000, 30_000)
    await at_rest(stack, group)
    assert group.state is MotionState.FAILED
    assert "SYNC" in str(group.error)


async def test_a_node_that_falls_silent_stops_the_others() -> None:
    async with stack_of(1, 2) as stack:
        await stack.ready()
        pair = stack.network.nodes[1].axes[0], stack.network.nodes[2].axes[0]
        await asyncio.gather(*(axis.enable() for axis in pair))
        group = stack.network.move_together([(pair[0], MoveRequest(900_000)), (pair[1], MoveRequest(90_000))])
        await asyncio.sleep(1)
        stack.modules[2].faults.silent = True
        assert await group.wait(20)
        assert group.state is MotionState.FAILED
        await until(lambda: not stack.modules[1].module.axes[0].moving, 5)
        assert position_of(pair[0]) < 300_000


async def test_while_somebody_has_the_sync_for_long_no_group_starts(stack: Stack) -> None:
    await stack.enabled()
    stack.node.backbone.sync.claim("a trajectory")
    with pytest.raises(NotReady, match="in use by a trajectory"):
        go(stack, 1, 2, 3)


@pytest.mark.parametrize("stopped", [None, 0, 1])
async def test_groups_begun_at_once_start_each_on_a_sync_of_its_own(stopped: int | None) -> None:
    """However close the second and the third come, also if one of them is stopped meanwhile."""
    async with stack_of(1, 2) as stack:
        await stack.ready()
        nodes = [stack.network.nodes[number].axes for number in (1, 2)]
        await asyncio.gather(*(axis.enable() for axes in nodes for axis in axes))
        watch, loop, way = Watch(stack), asyncio.get_running_loop(), 900
        syncs: list[float] = []
        stack.wire.tap(lambda _, f: syncs.append(loop.time()) if f.cob_id == SYNC else None)
        for quarters in range(24):  # of a millisecond
            way, groups = -way, []
            for number in range(3):
                pair = [(axes[number], MoveRequest(way, relative=True)) for axes in nodes]
                groups.append(stack.network.move_together(pair))
                await asyncio.sleep(quarters / 4000)
            if stopped is not None:
                await groups.pop(stopped).cancel()
            begun: list[float] = []
            for group in groups:
                await group.wait(30)
                assert group.state is MotionState.SUCCEEDED, (quarters, group.error)
                starts, _ = watch.last(*group.axes)
                assert starts[0] == starts[1], quarters
                begun.append(starts[0])
            assert len(set(begun)) == len(groups), quarters
            assert set(begun) <= set(syncs)
