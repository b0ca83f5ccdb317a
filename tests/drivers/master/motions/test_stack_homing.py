"""Homing through the master, stops in the middle of it included."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import Stack, position_of, result_of, until

from drivers.cia402.modes import Mode
from drivers.cia402.power import PowerState
from drivers.errors import BadValue, MotionTimeout, NotReady
from drivers.master import HomeRequest, MotionState, MoveRequest

pytestmark = pytest.mark.looptime


@pytest.mark.parametrize("method", [17, 18, 19, 21])
async def test_switches_are_found_and_become_zero(stack: Stack, method: int) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.home(HomeRequest(method=method, fast=200_000, slow=20_000, acceleration=1_000_000))
    await motion.wait(100)
    assert motion.state is MotionState.SUCCEEDED, motion.error
    assert axis.status.referenced
    assert abs(result_of(motion)["position"]) < 51_200
    after = axis.move_to(MoveRequest(0))
    await after.wait(30)
    assert after.state is MotionState.SUCCEEDED, after.error


async def test_method_35_needs_no_power(stack: Stack) -> None:
    axis = stack.axes[1]
    motion = axis.home(HomeRequest(method=35))
    await motion.wait(10)
    assert motion.state is MotionState.SUCCEEDED, motion.error
    assert axis.status.referenced
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED
    await axis.enable()
    assert axis.status.mode is Mode.NO_MODE


async def test_other_methods_need_power(stack: Stack) -> None:
    with pytest.raises(NotReady, match="switch_on_disabled"):
        stack.axes[0].home(HomeRequest(method=19))


async def test_a_method_that_the_module_lacks_is_refused(stack: Stack) -> None:
    with pytest.raises(BadValue, match="no homing method 4"):
        stack.axes[0].home(HomeRequest(method=4))


async def test_a_stop_in_mid_homing_is_no_success(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.home(HomeRequest(method=35)).wait(10)
    motion = axis.home(HomeRequest(method=18))
    await asyncio.sleep(3)
    assert axis.status.moving
    assert motion.state is MotionState.RUNNING
    await axis.stop()
    assert motion.state is MotionState.CANCELLED
    assert not axis.status.moving
    assert not axis.status.referenced
    rest = position_of(axis)
    await asyncio.sleep(5)
    assert axis.status.position == rest
    again = axis.move_to(MoveRequest(rest + 100))
    await again.wait(10)
    assert axis.status.position == rest + 100


async def test_a_homing_that_finds_nothing_ends_at_its_deadline_and_stands(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.home(HomeRequest(method=18, timeout_s=2))
    await motion.wait(30)
    assert motion.state is MotionState.FAILED
    assert isinstance(motion.error, MotionTimeout)
    await until(lambda: axis.errand is None)
    assert not axis.status.moving
    assert axis.status.state is PowerState.OPERATION_ENABLED


async def test_a_homing_that_moves_nothing_and_whose_start_is_lost_fails_soon(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.home(HomeRequest(method=35)).wait(10)
    stack.wire.faults.drop(lambda frame: frame.cob_id == axis.pdos.power.cob_id and frame.data[0] & 0x10 != 0)
    motion = axis.home(HomeRequest(method=35))
    assert await motion.wait(5)
    assert motion.state is MotionState.FAILED
    assert isinstance(motion.error, MotionTimeout)
