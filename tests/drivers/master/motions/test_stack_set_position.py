"""Saying where an axis stands: what it reads, what its limits do, and what a stop in between leaves."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import Stack, stack_of, until

from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.errors import AxisBusy, BadValue, MotionFailed, NotReady, StopLatched
from drivers.master import (
    AxisConfig,
    HomeRequest,
    MotionState,
    MoveRequest,
    SetPositionRequest,
    VelocityRequest,
)
from drivers.sim.motion.homing import Homing

pytestmark = pytest.mark.looptime

LIMITED = (
    AxisConfig(name="x", home_offset=300, soft_limits=(-10_000, 60_000)),
    AxisConfig(name="y", home_offset=300),
    AxisConfig(name="z"),
)


async def held(stack: Stack, axis: int = 0) -> tuple[object, ...]:
    """607Ch and both halves of 607Dh, as the module has them."""
    base = 0x800 * axis
    addresses = (Address(0x607C + base), Address(0x607D + base, 1), Address(0x607D + base, 2))
    return tuple([await stack.node.read(address) for address in addresses])


@pytest.mark.parametrize("position", [0, 12_345, -2_000_000_000])
async def test_the_axis_reads_the_position_and_is_homed_without_power(stack: Stack, position: int) -> None:
    axis = stack.axes[1]
    motion = axis.set_position(SetPositionRequest(position))
    await motion.wait(10)
    assert motion.state is MotionState.SUCCEEDED, motion.error
    assert motion.result == {"position": position, "method": 35}
    assert axis.status.position == position
    assert axis.status.referenced
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED
    assert await stack.node.read(Address(0x607C + 0x800)) == 0


async def test_offset_and_limits_are_the_module_s_own_again_and_moves_count_from_there() -> None:
    async with stack_of(1, axes=LIMITED) as stack:
        (axis, *_) = await stack.enabled()
        before = await held(stack)
        assert before == (300, -10_000, 60_000)
        motion = axis.set_position(SetPositionRequest(50_000))
        await motion.wait(10)
        assert motion.state is MotionState.SUCCEEDED, motion.error
        assert await held(stack) == before
        assert axis.status.state is PowerState.OPERATION_ENABLED
        assert not axis.status.emergencies
        move = axis.move_to(MoveRequest(59_700))
        await move.wait(30)
        assert move.state is MotionState.SUCCEEDED, move.error
        assert stack.modules[1].module.axes[0].motor.place(asyncio.get_running_loop().time()) == 9_700
        with pytest.raises(BadValue, match="outside"):
            axis.move_to(MoveRequest(59_701))


async def test_a_position_outside_the_limits_is_refused() -> None:
    async with stack_of(1, axes=LIMITED) as stack:
        await stack.ready()
        with pytest.raises(BadValue, match=r"position 59701 is outside -10300\.\.59700"):
            stack.axes[0].set_position(SetPositionRequest(59_701))


async def test_the_limits_of_a_homed_axis_move_only_if_that_is_meant() -> None:
    async with stack_of(1, axes=LIMITED) as stack:
        await stack.ready()
        axis = stack.axes[0]
        await axis.home(HomeRequest(method=35)).wait(10)
        assert axis.status.position == -300
        with pytest.raises(NotReady) as refused:
            axis.set_position(SetPositionRequest(0))
        assert [obstacle.code for obstacle in refused.value.obstacles] == ["limits_would_shift"]
        assert await axis.set_position(SetPositionRequest(-300)).wait(10)
        meant = axis.set_position(SetPositionRequest(0, shift_limits=True))
        await meant.wait(10)
        assert meant.state is MotionState.SUCCEEDED, meant.error
        assert axis.status.position == 0
        assert await held(stack) == (300, -10_000, 60_000)


async def test_it_is_refused_while_the_axis_moves_or_everything_is_stopped(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.run_at(VelocityRequest(20_000))
    with pytest.raises(AxisBusy):
        axis.set_position(SetPositionRequest(0))
    await until(lambda: axis.motion is None)
    with pytest.raises(AxisBusy, match="turning"):
        axis.set_position(SetPositionRequest(0))
    await stack.network.stop_all("Enough.")
    with pytest.raises(StopLatched):
        axis.set_position(SetPositionRequest(0))


async def test_a_module_whose_method_35_knows_only_zero_fails_it_and_keeps_its_offset(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    axis = stack.axes[0]
    monkeypatch.setattr(Homing, "_zero_from_here", lambda self, now: self.context.set_position(0, now))
    motion = axis.set_position(SetPositionRequest(500))
    await motion.wait(10)
    assert motion.state is MotionState.FAILED
    assert isinstance(motion.error, MotionFailed)
    assert "reads 0 instead of 500" in motion.error.message
    assert not axis.status.referenced
    assert await stack.node.read(Address(0x607C)) == 0
    assert await axis.set_position(SetPositionRequest(0)).wait(10)
    assert axis.status.referenced


@pytest.mark.parametrize("after", [0.001, 0.003, 0.02])
async def test_a_stop_in_between_leaves_the_offset_and_the_limits_as_configured(after: float) -> None:
    async with stack_of(1, axes=LIMITED) as stack:
        (axis, *_) = await stack.enabled()
        motion = axis.set_position(SetPositionRequest(1_000))
        await asyncio.sleep(after)
        await axis.stop()
        assert motion.done
        await until(lambda: stack.node.sdo.idle)
        move = axis.move_to(MoveRequest(100, relative=True))
        assert await held(stack) == (300, -10_000, 60_000)
        await move.wait(10)
        assert move.state is MotionState.SUCCEEDED, move.error


async def test_what_could_not_be_brought_back_is_before_the_next_motion() -> None:
    async with stack_of(1, axes=LIMITED) as stack:
        (axis, *_) = await stack.enabled()

        def brings_back(frame: Frame) -> bool:
            return frame.cob_id == cob.sdo_request(1) and frame.data[:4] == bytes((0x23, 0x7C, 0x60, 0))

        motion = axis.set_position(SetPositionRequest(1_000))
        await until(lambda: motion.started is not None)
        lost = stack.wire.faults.drop(brings_back)
        await motion.wait(10)
        lost.end()
        assert motion.state is MotionState.FAILED
        assert not axis.status.referenced
        assert (await held(stack))[0] == -1_000
        await until(lambda: axis.errand is None)
        move = axis.move_to(MoveRequest(2_000))
        await move.wait(10)
        assert move.state is MotionState.SUCCEEDED, move.error
        assert await held(stack) == (300, -10_000, 60_000)
