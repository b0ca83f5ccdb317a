"""Whether a module stops its motors when our heartbeat ends is only believed once it was seen."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import Stack, until

from drivers.cia402.power import PowerState
from drivers.errors import NotReady
from drivers.master import AxisCommand, Failsafe, MotionState, MoveRequest, NodeState

pytestmark = pytest.mark.looptime


async def test_the_check_makes_it_verified_until_the_next_boot_up(stack: Stack) -> None:
    axis = stack.axes[0]
    assert stack.node.failsafe is Failsafe.UNVERIFIED
    await axis.enable()
    assert await stack.network.verify_failsafe(1) is Failsafe.VERIFIED
    assert stack.node.status().failsafe is Failsafe.VERIFIED
    assert axis.status.state is PowerState.FAULT
    await axis.reset_fault()
    await axis.enable()
    motion = axis.move_to(MoveRequest(1000))
    await motion.wait(10)
    assert motion.state is MotionState.SUCCEEDED, motion.error
    stack.modules[1].power_cycle()
    await until(lambda: stack.node.state is not NodeState.OPERATIONAL)
    await stack.ready()
    assert stack.node.failsafe is Failsafe.UNVERIFIED


async def test_a_module_that_goes_on_is_found_out_and_not_enabled(stack: Stack) -> None:
    axis = stack.axes[0]
    await axis.enable()
    # It keeps hearing a heartbeat: to us it looks like a firmware that does not watch.
    stack.network._heartbeat.stop, silence = (lambda: None), stack.network._heartbeat.stop
    assert await stack.network.verify_failsafe(1) is Failsafe.OFF
    stack.network._heartbeat.stop = silence
    assert [o.code for o in axis.readiness(AxisCommand.MOVE)] == ["failsafe_off"]


async def test_the_check_needs_an_enabled_axis_and_standstill(stack: Stack) -> None:
    with pytest.raises(NotReady, match="enabled"):
        await stack.network.verify_failsafe(1)
    await stack.axes[0].enable()
    stack.axes[0].move_to(MoveRequest(100_000))
    with pytest.raises(NotReady, match="in use"):
        await stack.network.verify_failsafe(1)


async def test_nothing_begins_while_our_heartbeat_pauses(stack: Stack) -> None:
    await stack.axes[0].enable()
    check = asyncio.create_task(stack.network.verify_failsafe(1))
    await asyncio.sleep(0.1)
    with pytest.raises(NotReady, match="heartbeat pauses"):
        stack.axes[0].move_to(MoveRequest(1000))
    with pytest.raises(NotReady, match="Another check"):
        await stack.network.verify_failsafe(1)
    assert await check is Failsafe.VERIFIED
    assert stack.axes[1].readiness(AxisCommand.ENABLE) == ()
