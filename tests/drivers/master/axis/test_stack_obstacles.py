"""Limits, claims and readiness: what stands in the way is named with its remedy."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import AXES, Stack, stack_of, until

from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import MotionFailed, NotReady, Remedy
from drivers.master import (
    AxisCommand,
    AxisConfig,
    MotionState,
    MoveRequest,
    Network,
    NetworkConfig,
    NodeConfig,
    NodeState,
    VelocityRequest,
)

pytestmark = pytest.mark.looptime


async def test_a_limit_switch_ends_the_move_and_the_way_back_is_free(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(1_020_000, velocity=1_000_000, acceleration=2_000_000))
    await motion.wait(60)
    assert motion.state is MotionState.FAILED
    assert isinstance(motion.error, MotionFailed)
    assert "limit" in str(motion.error).lower()
    await until(lambda: axis.errand is None)
    await axis.reset_fault()
    await axis.enable()
    back = axis.move_to(MoveRequest(900_000))
    await back.wait(60)
    assert back.state is MotionState.SUCCEEDED, back.error


async def test_too_low_a_supply_fails_the_move_and_names_the_cause(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.modules[1].apply(lambda module, now: module.axes[0].supply(5.0, now))
    await motion.wait(30)
    assert motion.state is MotionState.FAILED
    assert "FF00" in str(motion.error)
    await until(lambda: axis.errand is None)
    assert not axis.status.moving


async def test_a_drive_that_still_reacts_to_a_fault_is_as_little_ready_as_one_in_fault() -> None:
    limited = AxisConfig("x", soft_limits=(-50_000, 50_000), quick_stop_deceleration=50_000)
    async with stack_of(1, axes=(limited,)) as stack:
        axis = (await stack.enabled())[0]
        motion = axis.run_at(VelocityRequest(100_000))
        await until(lambda: axis.status.state is PowerState.FAULT_REACTION_ACTIVE)
        for command in (AxisCommand.ENABLE, AxisCommand.MOVE):
            (found,) = (one for one in axis.readiness(command) if one.code == "fault")
            assert "fault_reaction_active" in found.message
            assert found.action is Remedy.RESET_FAULT
        assert axis.status.moving
        with pytest.raises(NotReady, match="fault_reaction_active"):
            await axis.enable()
        await axis.reset_fault()
        assert axis.readiness(AxisCommand.ENABLE) == ()
        assert motion.state is MotionState.FAILED


async def test_readiness_lists_every_obstacle_at_once(stack: Stack) -> None:
    axis = stack.axes[0]
    await stack.network.stop_all("a test")
    codes = [obstacle.code for obstacle in axis.readiness("move")]
    assert codes == ["stop_latched", "not_enabled"]
    assert all(obstacle.remedy and obstacle.message for obstacle in axis.readiness("move"))
    assert axis.readiness(AxisCommand.STOP) == ()
    with pytest.raises(ValueError, match="jump"):
        axis.readiness("jump")


async def test_an_adopted_axis_that_needs_its_power_off_says_so() -> None:
    async with stack_of(1) as stack:
        axis = (await stack.enabled())[0]
        await axis.run_at(VelocityRequest(20_000)).wait(10)
        await stack.master_dies()
        other = (AxisConfig(name="x", switch_parameters=3), *AXES[1:])
        config = NetworkConfig((NodeConfig(1, "m1", axes=other),))
        async with Network(stack.port, config, Catalog.load()) as second:
            node = second.node(1)
            await until(lambda: node.state is NodeState.OPERATIONAL)
            found = node.axes[0]
            await found.stop()
            with pytest.raises(NotReady, match="2005h is 0 instead of 3"):
                await found.enable()
            await found.disable()
            await found.enable()
            assert not found.adopted
            assert await node.read(Address(0x2005)) == 3
            await found.run_at(VelocityRequest(20_000)).wait(10)
        module = stack.modules[1].module
        assert [axis.state for axis in module.axes] == [PowerState.SWITCH_ON_DISABLED] * 3


async def test_closing_disables_what_nobody_claimed() -> None:
    async with stack_of(1) as stack:
        axis = (await stack.enabled())[0]
        await axis.run_at(VelocityRequest(20_000)).wait(10)
        await stack.master_dies()
        async with Network(stack.port, stack.network.config, Catalog.load()) as second:
            await until(lambda: second.ready)
            assert second.node(1).axes[0].adopted
        module = stack.modules[1].module
        await asyncio.sleep(0)
        assert [axis.state for axis in module.axes] == [PowerState.SWITCH_ON_DISABLED] * 3
        assert not module.axes[0].moving
