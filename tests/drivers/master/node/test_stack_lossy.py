"""A wire that loses, doubles and delays frames: what the master says is true, or it says what it lacks."""

from __future__ import annotations

import asyncio
import random

import pytest
from stack_kit import Stack, stack_of, until

from drivers.cia402 import objects
from drivers.cia402.power import PowerState
from drivers.errors import CanaxisError
from drivers.master import MotionState, MoveRequest, NodeState

pytestmark = pytest.mark.looptime


def position_in(stack: Stack) -> int | None:
    """Where the simulated motor of axis 0 really is."""
    now = asyncio.get_running_loop().time()
    return stack.modules[1].module.axes[0].read(objects.POSITION, 0, now)


async def recover(stack: Stack) -> None:
    """What a careful user does after a failure: wait for the node, reset, enable."""
    axis = stack.axes[0]
    for _ in range(20):
        try:
            await until(lambda: stack.node.state is NodeState.OPERATIONAL and not axis.status.stale, 60)
            await axis.stop()
            await axis.reset_fault()
            await axis.enable()
        except CanaxisError:
            await asyncio.sleep(1)
        else:
            return
    pytest.fail("the axis did not come back")


@pytest.mark.parametrize("seed", range(4))
async def test_a_success_is_always_true_and_nothing_moves_by_itself(seed: int) -> None:
    chance = random.Random(seed)
    async with stack_of(1) as stack:
        axis = (await stack.enabled())[0]
        stack.wire.faults.drop(lambda frame: chance.random() < 0.02)
        stack.wire.faults.duplicate(lambda frame: chance.random() < 0.02)
        stack.wire.faults.delay(lambda frame: chance.random() < 0.02, 0.003)
        succeeded = 0
        for _ in range(12):
            target = chance.randrange(-20_000, 20_000)
            try:
                motion = axis.move_to(MoveRequest(target))
                if chance.random() < 0.3:
                    await asyncio.sleep(chance.random() * 0.5)
                    await motion.cancel()
                await motion.wait(60)
            except CanaxisError:
                await recover(stack)
                continue
            if motion.state is MotionState.SUCCEEDED:
                succeeded += 1
                assert position_in(stack) == target
            else:
                await until(lambda: axis.errand is None, 60)
                await recover(stack)
                rest = position_in(stack)
                await asyncio.sleep(1)
                assert position_in(stack) == rest
        stack.wire.faults.clear()
        await recover(stack)
        assert axis.status.state is PowerState.OPERATION_ENABLED
        assert stack.network.failure is None
        assert succeeded >= 3
