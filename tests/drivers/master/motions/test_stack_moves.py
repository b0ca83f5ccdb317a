"""Axes moved through the master: to their targets, at velocities, and never further than asked."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import Stack, position_of, stack_of, until

from drivers.bus.frame import Frame
from drivers.bus.memory import MemoryWire
from drivers.cia301.nmt import NmtState
from drivers.cia402.modes import Mode
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import AxisBusy, BadValue, NotReady, StopLatched, UnknownAxis, UnknownNode
from drivers.master import AxisCommand, AxisConfig, HomeRequest, MotionState, MoveRequest, VelocityRequest
from drivers.master.network import Network
from drivers.master.plan.configuration import NetworkConfig, NodeConfig
from drivers.sim.runner import simulated_node

pytestmark = pytest.mark.looptime


async def test_three_axes_move_at_once_and_end_exactly(stack: Stack) -> None:
    axes = await stack.enabled()
    targets = (51200, -40000, 7)
    motions = [axis.move_to(MoveRequest(target)) for axis, target in zip(axes, targets, strict=True)]
    await asyncio.gather(*(motion.wait(30) for motion in motions))
    assert [motion.state for motion in motions] == [MotionState.SUCCEEDED] * 3, [m.error for m in motions]
    assert tuple(axis.status.position for axis in axes) == targets
    assert all(not axis.status.moving and axis.errand is None for axis in axes)


async def test_the_status_of_one_axis_never_shows_in_another(stack: Stack) -> None:
    axes = await stack.enabled()
    await axes[1].move_to(MoveRequest(2000)).wait(10)
    assert [axis.status.position for axis in axes] == [0, 2000, 0]
    assert [axis.status.mode for axis in axes] == [Mode.NO_MODE, Mode.PROFILE_POSITION, Mode.NO_MODE]


async def test_a_move_to_where_the_axis_stands_succeeds(stack: Stack) -> None:
    axes = await stack.enabled()
    motion = axes[0].move_to(MoveRequest(0))
    await motion.wait(10)
    assert motion.state is MotionState.SUCCEEDED
    assert motion.result == {"position": 0, "target": 0}


@pytest.mark.parametrize("distance", [1, -1, 25])
async def test_tiny_moves_end_exactly(stack: Stack, distance: int) -> None:
    axis = (await stack.enabled())[0]
    for step in range(1, 4):
        motion = axis.move_to(MoveRequest(distance, relative=True))
        await motion.wait(10)
        assert motion.state is MotionState.SUCCEEDED, motion.error
        assert axis.status.position == step * distance


async def test_a_relative_move_counts_from_where_a_stop_left_the_axis(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    await axis.stop()
    rest = position_of(axis)
    assert motion.state is MotionState.CANCELLED
    assert 0 < rest < 500_000
    again = axis.move_to(MoveRequest(1000, relative=True))
    await again.wait(10)
    assert axis.status.position == rest + 1000


async def test_after_a_stop_in_mid_move_nothing_continues_and_the_next_target_counts(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    await axis.stop("A test stops it.")
    rest = position_of(axis)
    assert axis.status.state is PowerState.OPERATION_ENABLED
    assert "A test stops it." in str(motion.error)
    await asyncio.sleep(5)
    assert axis.status.position == rest
    await axis.move_to(MoveRequest(rest - 2000)).wait(10)
    assert axis.status.position == rest - 2000
    await asyncio.sleep(5)
    assert axis.status.position == rest - 2000


async def test_cancelling_a_motion_returns_at_standstill(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    await motion.cancel()
    assert motion.state is MotionState.CANCELLED
    assert not axis.status.moving


async def test_a_stop_while_the_move_is_being_prepared_keeps_it_from_starting(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(10_000))
    assert motion.state is MotionState.QUEUED
    await asyncio.sleep(0.0003)  # in the middle of an SDO
    await axis.stop()
    assert motion.state is MotionState.CANCELLED
    await asyncio.sleep(2)
    assert axis.status.position == 0
    assert stack.node.counters.sdo.cancelled == 1


async def test_a_stop_on_a_standing_axis_is_quiet(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.stop()
    await axis.stop()
    assert axis.status.state is PowerState.OPERATION_ENABLED
    await stack.axes[0].disable()
    await axis.stop()
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED


async def test_turning_reaches_its_velocity_and_can_be_given_another(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    first = axis.run_at(VelocityRequest(100_000))
    await asyncio.sleep(0.3)
    second = axis.run_at(VelocityRequest(20_000))
    assert first.state is MotionState.CANCELLED
    await second.wait(10)
    assert second.state is MotionState.SUCCEEDED, second.error
    assert axis.status.velocity == 20_000
    assert axis.motion is None
    third = axis.run_at(VelocityRequest(-20_000))
    await third.wait(10)
    assert abs(axis.status.velocity + 20_000) <= 200
    with pytest.raises(AxisBusy, match="turning"):
        axis.move_to(MoveRequest(0))
    await axis.run_at(VelocityRequest(0)).wait(10)
    assert not axis.status.moving
    last = axis.move_to(MoveRequest(0))
    await last.wait(20)
    assert axis.status.position == 0


async def test_an_old_velocity_never_starts_the_motor_with_the_mode(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    await axis.stop()
    rest = axis.status.position
    await axis.run_at(VelocityRequest(0)).wait(10)
    assert axis.status.position == rest


async def test_quick_stop_ends_switched_off(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    await axis.quick_stop()
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED
    assert motion.state is MotionState.CANCELLED
    rest = axis.status.position
    await axis.enable()
    await asyncio.sleep(1)
    assert axis.status.position == rest


async def test_disable_in_mid_move_ramps_down_first(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    at = position_of(axis)
    await axis.disable()
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED
    assert position_of(axis) > at + 5000
    assert motion.state is MotionState.CANCELLED


async def test_a_second_command_on_a_busy_axis_is_refused_by_name(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.move_to(MoveRequest(100_000))
    with pytest.raises(AxisBusy) as refused:
        axis.move_to(MoveRequest(0))
    assert "moving" in str(refused.value)
    assert [o.code for o in axis.readiness(AxisCommand.MOVE)] == ["busy"]
    await axis.stop()


async def test_a_disabled_axis_says_what_to_do(stack: Stack) -> None:
    axis = stack.axes[0]
    with pytest.raises(NotReady, match="switch_on_disabled") as refused:
        axis.move_to(MoveRequest(5))
    assert "Enable the axis" in refused.value.hint


async def test_software_limits_are_checked_before_anything_is_sent() -> None:
    axes = (AxisConfig(name="x", soft_limits=(-1000, 1000)),)
    async with stack_of(1, axes=axes) as stack:
        axis = (await stack.enabled())[0]
        sent = stack.network.counters.sent
        with pytest.raises(BadValue, match=r"-1000\.\.1000"):
            axis.move_to(MoveRequest(1001))
        assert stack.network.counters.sent == sent
        await axis.move_to(MoveRequest(1000)).wait(10)
        with pytest.raises(BadValue):
            axis.move_to(MoveRequest(1, relative=True))


async def test_an_absolute_move_can_be_made_to_need_a_reference() -> None:

    async with stack_of(1, axes=(AxisConfig(name="x", require_homing=True),)) as stack:
        axis = (await stack.enabled())[0]
        with pytest.raises(NotReady, match="not homed"):
            axis.move_to(MoveRequest(5))
        await axis.home(HomeRequest(method=35)).wait(10)
        assert axis.status.referenced
        await axis.move_to(MoveRequest(5)).wait(10)
        assert axis.status.position == 5


async def test_stop_all_latches_stops_and_must_be_reset(stack: Stack) -> None:
    axes = await stack.enabled()
    motions = [axis.move_to(MoveRequest(500_000)) for axis in axes[:2]]
    await asyncio.sleep(1)
    report = await stack.network.stop_all("test")
    assert report.complete
    assert len(report.axes) == 3
    assert [motion.state for motion in motions] == [MotionState.CANCELLED] * 2
    with pytest.raises(StopLatched):
        axes[0].move_to(MoveRequest(0))
    with pytest.raises(StopLatched):
        await axes[0].enable()
    stack.network.reset_stop()
    await axes[0].move_to(MoveRequest(0)).wait(20)
    assert axes[0].status.position == 0


async def test_closing_ramps_down_and_disables() -> None:
    async with stack_of(1) as stack:
        axis = (await stack.enabled())[0]
        axis.move_to(MoveRequest(500_000))
        await asyncio.sleep(1)
        module = stack.modules[1].module
        heard: list[int] = []
        stack.wire.tap(lambda _, frame: heard.append(frame.cob_id))
        await stack.network.close()
        assert [a.state for a in module.axes] == [PowerState.SWITCH_ON_DISABLED] * 3
        assert not module.axes[0].moving
        await asyncio.sleep(5)  # our heartbeat ended: no error to a module that was taken leave of
        assert [a.state for a in module.axes] == [PowerState.SWITCH_ON_DISABLED] * 3
        assert module.nmt_state is NmtState.PRE_OPERATIONAL
        assert 0x81 not in heard


async def test_names_and_numbers_find_nodes_and_axes(stack: Stack) -> None:
    network = stack.network
    assert network.node("m1") is network.node(1) is network.node("1")
    assert network.node(1).axis("y") is network.node(1).axis(1) is network.node(1).axis("1")
    with pytest.raises(UnknownNode):
        network.node(2)
    with pytest.raises(UnknownAxis):
        network.node(1).axis("w")


async def test_a_vanished_waiter_changes_nothing(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(30_000))
    waiter = asyncio.create_task(motion.wait(20))
    await asyncio.sleep(0.1)
    waiter.cancel()
    await until(lambda: motion.done)
    assert motion.state is MotionState.SUCCEEDED
    assert axis.status.position == 30_000


async def test_an_enable_whose_caller_vanished_goes_on(stack: Stack) -> None:
    axis = stack.axes[0]
    caller = asyncio.create_task(axis.enable())
    await asyncio.sleep(0.001)
    caller.cancel()
    await until(lambda: axis.status.state is PowerState.OPERATION_ENABLED)
    assert axis.errand is None


async def test_a_stop_ends_an_enable_that_is_under_way(stack: Stack) -> None:
    axis = stack.axes[0]
    caller = asyncio.create_task(axis.enable())
    await asyncio.sleep(0.001)
    await axis.stop()
    with pytest.raises(NotReady, match="ended by a stop"):
        await caller


async def test_a_heartbeat_of_four_seconds_is_waited_for() -> None:
    wire, catalog = MemoryWire(), Catalog.load()
    config = NetworkConfig(nodes=(NodeConfig(1, "slow"),), node_heartbeat_ms=4000)
    async with (
        simulated_node(wire, catalog.profile("TMCM-3216")),
        Network(wire.port("master"), config, catalog) as network,
    ):
        await until(lambda: network.ready, 20)
        await network.node(1).axes[0].enable()


async def test_a_mode_that_is_commanded_again_never_enables_a_drive_that_was_switched_off(
    stack: Stack,
) -> None:
    axis = (await stack.enabled())[0]
    motor = stack.modules[1].module.axes[0]
    stack.wire.faults.drop(lambda frame: frame.cob_id == 0x201 and frame.data[2] == Mode.PROFILE_POSITION)
    motion = axis.move_to(MoveRequest(1000))
    await asyncio.sleep(0.05)  # the mode was commanded, and will be again
    stack.wire.faults.clear()
    stack.wire.inject(Frame(0x201, bytes([0x07, 0, 0])))  # somebody else switches its operation off
    await until(lambda: motor.state is PowerState.SWITCHED_ON)
    await motion.wait(20)
    assert motion.state is MotionState.FAILED
    assert motor.state is PowerState.SWITCHED_ON
