"""An axis's settings on the way into the module: at boot-up, and while the service runs."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from fractions import Fraction

import pytest
from stack_kit import NeverAbove, Stack, stack_of, until

from drivers.cia301.objects import Address
from drivers.errors import AxisBusy, BadValue, ConfigurationRefused, NodeAway, NotReady, RulesBroken
from drivers.master import AxisConfig, HomeRequest, MotionState, MoveRequest, NodeState
from drivers.master.axis.reconfigure import reconfigure
from drivers.master.node import storing
from drivers.master.node.storing import StoredGroup
from drivers.master.plan.gearing import Gearing
from drivers.master.plan.prediction import predict_move

pytestmark = pytest.mark.looptime


async def test_the_resolution_of_a_geared_axis_is_written_at_boot_up_and_no_other() -> None:
    geared = AxisConfig("y", unit="mm", gearing=Gearing(400, 16, Fraction(3), Fraction(5000)))
    async with stack_of(1, axes=(AxisConfig("x"), geared, AxisConfig("z"))) as stack:
        await stack.ready()
        held = {
            (index, sub): await stack.node.read(Address(index, sub))
            for index, sub in ((0x2000, 0), (0x2001, 0), (0x2200, 0), (0x2201, 0))
        }
        assert held == {(0x2000, 0): 8, (0x2001, 0): 200, (0x2200, 0): 4, (0x2201, 0): 400}
        changed = [c.address for step in stack.node.status().boot for c in step.changes]
        assert Address(0x2200, 0) in changed
        assert Address(0x2000, 0) not in changed


async def kept() -> None:
    """A store that works."""


def failing(error: Exception) -> Callable[[], Awaitable[None]]:
    async def keep() -> None:
        raise error

    return keep


async def held(stack: Stack, index: int, sub: int = 0, axis: int = 0) -> object:
    return await stack.node.read(stack.node.objects.address(index, sub, axis))


async def test_other_settings_are_written_read_back_and_gone_by_at_once(stack: Stack) -> None:
    axis = stack.axes[1]
    wanted = replace(
        axis.config, velocity=30_000, max_velocity=40_000, run_current=200, soft_limits=(-1000, 9000)
    )
    changes = await reconfigure({axis: wanted}, kept)
    assert {change.name for change in changes[axis]} == {
        "Profile Velocity", "Maximum current", "Minimum Position Limit", "Maximum Position Limit",
    }  # fmt: skip
    assert await held(stack, 0x6081, axis=1) == 30_000
    assert await held(stack, 0x2003, axis=1) == 200
    assert axis.config is wanted
    await axis.enable()
    with pytest.raises(BadValue, match=r"-1000\.\.9000"):
        axis.move_to(MoveRequest(9001))
    with pytest.raises(RulesBroken, match="max_velocity") as caught:
        axis.move_to(MoveRequest(100, velocity=40_001))
    assert [rule.rule for rule in caught.value.rules] == ["max_velocity"]
    motion = axis.move_to(MoveRequest(9000))
    await motion.wait(60)
    assert motion.state is MotionState.SUCCEEDED


@pytest.mark.looptime
async def test_a_move_has_the_speed_asked_of_it_whatever_settings_were_written_before(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    speeds: list[int] = []
    stack.wire.tap(lambda _, frame: speeds.append(abs(axis.status.velocity or 0)))
    for usual, asked in ((60_000, 30_000), (12_000, 30_000), (48_000, 30_000), (24_000, None)):
        await reconfigure({axis: replace(axis.config, velocity=usual)}, kept)
        speeds.clear()
        motion = axis.move_to(MoveRequest(60_000, relative=True, velocity=asked))
        assert await motion.wait(10)
        assert (motion.state, max(speeds)) == (MotionState.SUCCEEDED, asked or usual)


async def test_limits_and_start_velocities_cross_over_without_passing_each_other(stack: Stack) -> None:
    axis = stack.axes[0]
    pairs = [
        NeverAbove(stack, Address(0x607D, 1), Address(0x607D, 2)),
        NeverAbove(stack, Address(0x2010, 0), Address(0x6082, 0)),
    ]
    for limits, start, end in (
        ((5000, 6000), 500, 600),
        ((-200, -100), 5, 20),
        ((10_000, 20_000), 9000, 9000),
    ):
        wanted = replace(axis.config, soft_limits=limits, start_velocity=start, end_velocity=end)
        before = [pair.seen[-1] for pair in pairs]
        with pytest.raises(OSError, match="full"):
            await reconfigure({axis: wanted}, failing(OSError("full")))
        assert [pair.seen[-1] for pair in pairs] == before
        await reconfigure({axis: wanted}, kept)
        assert [pair.seen[-1] for pair in pairs] == [limits, (start, end)]
    for pair in pairs:
        assert pair.kept, pair.seen


async def test_what_the_module_refuses_half_way_is_taken_back_on_every_axis(stack: Stack) -> None:
    x, y, _ = stack.axes
    before = {axis: axis.config for axis in (x, y)}
    stack.wire.faults.corrupt(  # y refuses its velocity, once everything before that was written
        lambda frame: frame._replace(data=bytes.fromhex("80 81 68 00 30 00 09 06")),
        lambda frame: frame.cob_id == 0x581 and frame.data[:4] == bytes.fromhex("60 81 68 00"),
        count=1,
    )
    with pytest.raises(ConfigurationRefused):
        await reconfigure(
            {x: replace(x.config, run_current=77), y: replace(y.config, run_current=78, velocity=999)}, kept
        )
    assert (await held(stack, 0x2003), await held(stack, 0x2003, axis=1)) == (128, 128)
    assert {axis: axis.config for axis in (x, y)} == before
    await x.enable()


async def test_an_axis_whose_settings_could_not_be_taken_back_moves_only_after_a_boot(stack: Stack) -> None:
    axis = stack.axes[0]
    stack.wire.faults.corrupt(
        lambda frame: frame._replace(data=bytes.fromhex("80 03 20 00 30 00 09 06")),
        lambda frame: frame.cob_id == 0x581 and frame.data[:4] == bytes.fromhex("60 03 20 00"),
    )
    with pytest.raises(ConfigurationRefused):
        await reconfigure({axis: replace(axis.config, run_current=77)}, kept)
    stack.wire.faults.clear()
    with pytest.raises(NotReady) as caught:
        await axis.enable()
    assert [obstacle.code for obstacle in caught.value.obstacles] == ["settings_unsettled"]
    await stack.node.boot()
    await axis.enable()


async def test_what_can_t_be_kept_is_taken_back(stack: Stack) -> None:
    axis = stack.axes[0]
    before = axis.config
    with pytest.raises(OSError, match="full"):
        await reconfigure({axis: replace(before, velocity=12_345)}, failing(OSError("full")))
    assert await held(stack, 0x6081) == before.velocity
    assert axis.config is before
    assert not axis.configuring


async def test_settings_wait_for_an_axis_that_moves_and_some_for_its_power(stack: Stack) -> None:
    axis = stack.axes[0]
    await axis.enable()
    motion = axis.move_to(MoveRequest(100_000))
    with pytest.raises(AxisBusy):
        await reconfigure({axis: replace(axis.config, velocity=1000)}, kept)
    await motion.wait(60)
    await reconfigure({axis: replace(axis.config, velocity=1000)}, kept)
    for still in (
        {"switch_parameters": 3},
        {"encoder_direction": 1},
        {"gearing": Gearing()},
        {"encoder": True},
    ):
        with pytest.raises(NotReady) as caught:
            await reconfigure({axis: replace(axis.config, **still)}, kept)
        assert [obstacle.code for obstacle in caught.value.obstacles] == ["disable_first"]
    await axis.disable()
    await reconfigure({axis: replace(axis.config, switch_parameters=3)}, kept)
    assert await held(stack, 0x2005) == 3


async def test_nothing_else_begins_while_settings_are_written_and_a_stop_is_never_held_up(
    stack: Stack,
) -> None:
    axis = stack.axes[0]
    await axis.enable()
    release = asyncio.Event()

    async def slow() -> None:
        await release.wait()

    task = asyncio.create_task(reconfigure({axis: replace(axis.config, velocity=777)}, slow))
    await until(lambda: axis.configuring)
    with pytest.raises(AxisBusy):
        axis.move_to(MoveRequest(5))
    await axis.stop()
    release.set()
    await task
    assert axis.config.velocity == 777
    await axis.move_to(MoveRequest(5)).wait(30)


async def test_a_module_that_starts_anew_meanwhile_keeps_the_old_settings(stack: Stack) -> None:
    axis = stack.axes[0]
    before = axis.config

    async def reset() -> None:
        stack.modules[1].power_cycle()
        await until(lambda: axis.lives > 0)
        raise OSError("no matter")

    with pytest.raises(OSError, match="matter"):
        await reconfigure({axis: replace(before, velocity=777)}, reset)
    await stack.ready()
    await until(lambda: not axis.status.stale)
    assert await held(stack, 0x6081) == before.velocity


async def test_a_module_that_starts_anew_while_another_is_written_keeps_the_old_settings_of_both() -> None:
    async with stack_of(1, 2, axes=(AxisConfig("x"),)) as stack:
        await stack.ready()
        first, second = (node.axes[0] for node in stack.network.nodes.values())
        before = first.config.velocity
        others_turn = asyncio.Event()
        stack.wire.tap(lambda _, frame: others_turn.set() if frame.cob_id == 0x602 else None)

        async def restart() -> None:
            await others_turn.wait()
            stack.modules[1].power_cycle()

        restarting = asyncio.create_task(restart())
        with pytest.raises(NodeAway, match="started anew"):
            await reconfigure({a: replace(a.config, velocity=777) for a in (first, second)}, kept)
        await restarting
        assert (first.config.velocity, second.config.velocity) == (before, before)
        await until(lambda: stack.node.state is not NodeState.OPERATIONAL)
        await stack.ready()
        for axis in (first, second):
            assert await axis.node.read(Address(0x6081, 0)) == before


async def test_a_module_that_starts_anew_while_they_are_kept_must_be_taken_in_before_it_moves(
    stack: Stack,
) -> None:
    axis = stack.axes[0]

    async def reset() -> None:
        stack.modules[1].power_cycle()
        await until(lambda: stack.node.state is not NodeState.OPERATIONAL)
        await stack.ready()
        await until(lambda: not axis.status.stale)

    await reconfigure({axis: replace(axis.config, velocity=777)}, reset)
    assert axis.config.velocity == 777
    with pytest.raises(NotReady) as caught:
        await axis.enable()
    assert [obstacle.code for obstacle in caught.value.obstacles] == ["settings_unsettled"]
    await stack.node.boot()
    assert await held(stack, 0x6081) == 777
    await axis.enable()


async def test_a_node_is_not_taken_in_anew_while_settings_are_written(stack: Stack) -> None:
    axis = stack.axes[1]

    async def boot() -> None:
        with pytest.raises(NotReady, match=r"Axis y is being given other settings\.") as caught:
            await stack.node.boot()
        assert [obstacle.code for obstacle in caught.value.obstacles] == ["in_use"]

    await reconfigure({axis: replace(axis.config, velocity=777)}, boot)
    assert stack.node.state is NodeState.OPERATIONAL
    assert await held(stack, 0x6081, axis=1) == 777
    await stack.node.boot()


async def test_ranges_are_the_module_s_and_are_looked_at_before_anything_is_written(stack: Stack) -> None:
    axis = stack.axes[0]
    with pytest.raises(RulesBroken, match="2003h") as caught:
        await reconfigure({axis: replace(axis.config, run_current=256, homing_method=4)}, kept)
    assert [rule.rule for rule in caught.value.rules] == ["range_2003h", "range_6098h"]


async def test_the_prediction_follows_an_eight_point_ramp(stack: Stack) -> None:
    axis = stack.axes[0]
    plain = predict_move(axis.config, 0, 100_000)
    shaped = replace(
        axis.config,
        ramp_a1=10_000,
        ramp_v1=20_000,
        ramp_d1=10_000,
        ramp_a2=20_000,
        ramp_v2=40_000,
        ramp_d2=20_000,
    )
    await reconfigure({axis: shaped}, kept)
    slower = predict_move(axis.config, 0, 100_000)
    assert slower.duration_s > plain.duration_s + 1
    await axis.enable()
    loop = asyncio.get_running_loop()
    begun = loop.time()
    motion = axis.move_to(MoveRequest(100_000))
    await motion.wait(60)
    assert motion.state is MotionState.SUCCEEDED
    assert abs(loop.time() - begun - slower.duration_s) < 0.5


async def test_another_home_offset_loses_the_reference(stack: Stack) -> None:
    axis = stack.axes[0]
    await axis.home(HomeRequest()).wait(30)
    await reconfigure({axis: replace(axis.config, velocity=5)}, kept)
    assert axis.status.referenced
    await reconfigure({axis: replace(axis.config, home_offset=500)}, kept)
    assert not axis.status.referenced


async def test_a_module_stores_and_restores_only_with_every_axis_off(stack: Stack) -> None:
    node, axis = stack.node, stack.axes[2]
    await axis.enable()
    with pytest.raises(NotReady, match="switched off"):
        await storing.store(node, StoredGroup.ALL)
    await axis.disable()
    await reconfigure({axis: replace(axis.config, run_current=99)}, kept)
    await storing.store(node, StoredGroup.AXIS, 2)
    with pytest.raises(BadValue, match="no function"):
        await storing.restore_defaults(node, StoredGroup.COMMUNICATION)
    with pytest.raises(BadValue, match="named"):
        await storing.store(node, StoredGroup.AXIS)
    await storing.restore_defaults(node, StoredGroup.AXIS, 2)
    assert await held(stack, 0x2003, axis=2) == 99, "nothing changes before the reset"
