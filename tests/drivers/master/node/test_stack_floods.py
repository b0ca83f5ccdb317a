"""Too much of everything: bounded memory, true counters, and a stop that is served all the same."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import Stack, until

from drivers.bus.frame import Frame
from drivers.cia402.power import PowerState
from drivers.master import MotionState, MoveRequest, NodeState, VelocityRequest
from drivers.master.seen.emergencies import CAPACITY

pytestmark = pytest.mark.looptime

FLOOD = 3000


async def test_a_flood_of_emergencies_is_bounded_and_a_stop_is_served(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    before = stack.node.counters.emergencies
    subscription = stack.network.events.subscribe(16)
    for number in range(FLOOD):
        # FF01h, byte #2 = axis 1: another axis's; every byte #1, so that all of them would be active at once
        stack.wire.inject(Frame(0x081, bytes([0x01, 0xFF, 0x81, number % 256, 1, 0, 0, number // 256])))
    await axis.stop()
    assert axis.status.state is PowerState.OPERATION_ENABLED
    assert not stack.modules[1].module.axes[0].moving
    assert stack.node.counters.emergencies == before + FLOOD
    assert len(stack.node.emergencies) == CAPACITY
    assert len(stack.node.status().emergencies) <= CAPACITY
    assert subscription.missed > 0
    assert stack.network.failure is None


async def test_a_flood_of_foreign_identifiers_is_counted_and_a_move_goes_on(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(30_000))
    before = stack.network.counters.unrouted
    for number in range(FLOOD):
        stack.wire.inject(Frame(0x7F0 + number % 8, bytes(8)))
        if number % 100 == 0:
            await asyncio.sleep(0.001)
    await motion.wait(10)
    assert motion.state is MotionState.SUCCEEDED, motion.error
    assert axis.status.position == 30_000
    assert stack.network.counters.unrouted == before + FLOOD


async def test_boot_ups_over_and_over_leave_the_node_usable_at_last(stack: Stack) -> None:
    await stack.enabled()
    for _ in range(50):
        stack.wire.inject(Frame(0x701, b"\x00"))
        await asyncio.sleep(0.002)
    await until(lambda: stack.node.state is NodeState.DUPLICATE)
    await until(lambda: stack.node.state is NodeState.OPERATIONAL, 60)
    axis = stack.axes[0]
    assert axis.adopted, "an enabled axis is nobody's after a boot-up that was none"
    await axis.enable()
    await axis.move_to(MoveRequest(100)).wait(10)
    assert axis.status.position == 100
    assert stack.network.failure is None
