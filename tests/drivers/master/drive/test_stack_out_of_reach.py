"""Nodes and axes out of reach for a while: what is owed to them is made good, and nothing resumes."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from stack_kit import Stack, position_of, result_of, stack_of, until

from drivers.bus.faults import Predicate, cob_id
from drivers.bus.frame import Frame
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import (
    BusDown,
    BusOverflow,
    MotionFailed,
    MotionTimeout,
    NodeAway,
    NotReady,
    SdoTimeout,
    TransitionTimeout,
)
from drivers.master import (
    AxisConfig,
    Failsafe,
    HomeRequest,
    MotionState,
    MoveRequest,
    Network,
    NodeState,
    StopOutcome,
    VelocityRequest,
)

pytestmark = pytest.mark.looptime


def deaf_and_mute(stack: Stack) -> None:
    """The node's stub of the bus is cut, but our heartbeat still reaches it: its motors go on."""
    stack.wire.faults.drop(lambda frame: frame.cob_id != 0x77F)


async def test_a_stop_for_everything_reaches_a_node_that_was_away_when_it_comes_back(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    deaf_and_mute(stack)
    await until(lambda: stack.node.state is NodeState.LOST)
    report = await stack.network.stop_all("a test")
    assert report.axes[0].outcome is StopOutcome.UNREACHABLE
    assert stack.modules[1].module.axes[0].moving
    stack.wire.faults.clear()
    await stack.ready()
    await until(lambda: axis.errand is None and not axis.status.moving)
    assert not stack.modules[1].module.axes[0].moving


async def test_an_axis_that_we_commanded_and_lost_is_stopped_when_it_is_back(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(2_000_000))
    await asyncio.sleep(1)
    deaf_and_mute(stack)
    await until(lambda: stack.node.state is NodeState.LOST)
    assert motion.state is MotionState.FAILED
    stack.wire.faults.clear()
    await stack.ready()
    await until(lambda: axis.errand is None and not axis.status.moving)
    rest = position_of(axis)
    await axis.enable()
    await axis.move_to(MoveRequest(500, relative=True)).wait(10)
    assert axis.status.position == rest + 500


async def test_a_halted_set_point_of_a_dead_master_is_never_taken_up() -> None:
    async with stack_of(1) as stack:
        axis = (await stack.enabled())[0]
        axis.move_to(MoveRequest(500_000))
        await asyncio.sleep(1)
        axis.begin_stop("the last that it did")
        await asyncio.sleep(0.01)
        await stack.master_dies()
        module = stack.modules[1].module
        async with Network(stack.port, stack.network.config, Catalog.load()) as second:
            await until(lambda: second.ready)
            found = second.node(1).axes[0]
            await until(lambda: not (found.status.moving or found.status.stale or found.status.velocity))
            rest = position_of(found)
            await found.enable()
            assert not module.axes[0].moving
            await found.run_at(VelocityRequest(0)).wait(10)
            assert found.status.position == rest
            again = found.move_to(MoveRequest(rest - 100))
            await until(lambda: again.done)
            assert (again.state, found.status.position) == (MotionState.SUCCEEDED, rest - 100), again.error


async def test_a_failsafe_counts_as_unverified_once_the_node_was_off(stack: Stack) -> None:
    await stack.axes[0].enable()
    assert await stack.network.verify_failsafe(1) is Failsafe.VERIFIED
    stack.modules[1].apply(lambda module, now: module.axes[1].short("a", now))
    stack.modules[1].power_off()
    await until(lambda: stack.node.state is NodeState.LOST)
    await asyncio.sleep(3)
    stack.modules[1].apply(lambda module, now: module.axes[1].mend(now))
    stack.modules[1].power_on()
    await stack.ready()
    assert stack.node.failsafe is Failsafe.UNVERIFIED
    assert stack.node.status().emergencies == ()
    assert stack.node.counters.losses == 1


async def test_a_turning_axis_whose_status_stops_coming_is_stopped(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    assert axis.motion is None
    stack.wire.faults.drop(cob_id(axis.pdos.motion.cob_id))
    module = stack.modules[1].module
    await until(lambda: not module.axes[0].moving, 3)
    assert axis.status.stale
    assert stack.axes[1].status.stale is False


async def test_bus_off_says_can_t_command_and_never_stopped(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.port.bus_off()
    assert motion.state is MotionState.FAILED
    with pytest.raises(BusDown, match="can be commanded"):
        axis.move_to(MoveRequest(0))
    with pytest.raises(NodeAway, match="unknown"):
        await axis.stop()
    await until(lambda: stack.modules[1].module.axes[0].state is PowerState.FAULT)
    stack.port.recover()
    await stack.ready()
    assert axis.status.state is PowerState.FAULT
    assert stack.network.bus_status().reason == ""


async def test_after_lost_messages_a_move_goes_on_if_the_drive_shows_what_was_commanded(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(100_000))
    turning = stack.axes[1].run_at(VelocityRequest(400_000))
    await asyncio.sleep(1)
    stack.modules[1].report(0x8110)
    await asyncio.gather(motion.wait(20), turning.wait(20))
    assert [one.state for one in (motion, turning)] == [MotionState.SUCCEEDED] * 2, (
        motion.error,
        turning.error,
    )


async def test_a_fault_of_the_module_s_own_can_says_that_the_last_command_is_unconfirmed(
    stack: Stack,
) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    await stack.node.write(Address(0x607A), 400_000)
    stack.modules[1].report(0x8110)
    await motion.wait(1)
    assert isinstance(motion.error, MotionFailed)
    assert "unconfirmed" in str(motion.error)
    await until(lambda: axis.errand is None)
    assert not stack.modules[1].module.axes[0].moving


async def test_closing_with_a_node_that_does_not_answer_is_bounded_and_ends_our_heartbeat() -> None:
    async with stack_of(1, 2) as stack:
        await stack.ready()
        silent, other = stack.network.node(1).axes[0], stack.network.node(2).axes[0]
        await asyncio.gather(silent.enable(), other.enable())
        silent.move_to(MoveRequest(2_000_000))
        other.move_to(MoveRequest(2_000_000))
        await asyncio.sleep(1)
        stack.wire.faults.drop(lambda frame: frame.cob_id & 0x7F == 1 and frame.cob_id & 0x780 != 0x600)
        loop = asyncio.get_running_loop()
        begun = loop.time()
        await asyncio.gather(stack.network.close(), stack.network.close())
        assert loop.time() - begun < stack.network.timing.shutdown + 1
        assert stack.modules[2].module.axes[0].state is PowerState.SWITCH_ON_DISABLED
        heard: list[Frame] = []
        stack.wire.tap(lambda _, frame: heard.append(frame) if frame.cob_id == 0x77F else None)
        await asyncio.sleep(2)
        assert heard == []
        assert not stack.modules[1].module.axes[0].moving


async def test_a_configured_value_that_the_module_can_t_take_refuses_the_node_and_nothing_else() -> None:
    config = AxisConfig(name="x")
    object.__setattr__(config, "switch_parameters", 64)  # what the configuration itself would not let through
    async with stack_of(1, axes=(config,)) as stack:
        await until(lambda: stack.node.state is NodeState.REFUSED)
        assert "0..63, not 64" in stack.node.reason
        assert stack.network.failure is None


async def test_quick_stop_and_disable_get_through_once_a_full_queue_drains(stack: Stack) -> None:
    axes = await stack.enabled()
    for axis in axes[:2]:
        axis.move_to(MoveRequest(2_000_000))
    await asyncio.sleep(1)
    stack.port.hold()
    with contextlib.suppress(BusOverflow):
        while True:
            stack.port.send(Frame(0x7E5, bytes(8)), urgent=True)
    commands = [asyncio.create_task(axes[0].quick_stop()), asyncio.create_task(axes[1].disable())]
    await asyncio.sleep(0.05)
    stack.port.release()
    await asyncio.gather(*commands)
    assert [axis.status.state for axis in axes[:2]] == [PowerState.SWITCH_ON_DISABLED] * 2
    assert not any(axis.moving for axis in stack.modules[1].module.axes)


async def test_a_stop_follows_a_gentle_ramp_to_its_end(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.move_to(MoveRequest(5_000_000, velocity=60_000, deceleration=6_000))
    await asyncio.sleep(2)
    await axis.stop()
    assert axis.status.state is PowerState.OPERATION_ENABLED
    assert not axis.status.moving


async def test_what_succeeded_is_what_the_status_shows(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    for velocity in (400_000, -300_000, 70_000, 0):
        motion = axis.run_at(VelocityRequest(velocity, acceleration=900_000))
        await until(lambda motion=motion: motion.done)
        assert motion.state is MotionState.SUCCEEDED, motion.error
        assert (axis.status.velocity, result_of(motion)["velocity"]) == (velocity, velocity)
    motion = axis.home(HomeRequest(method=35))
    await motion.wait(10)
    assert (axis.status.position, axis.status.referenced, result_of(motion)["position"]) == (0, True, 0)
    for target in (70_000, -3, 4_000):
        motion = axis.move_to(MoveRequest(target, velocity=400_000, acceleration=900_000))
        await motion.wait(10)
        assert (axis.status.position, axis.status.velocity, axis.status.moving) == (target, 0, False)


async def test_a_stop_in_the_course_of_an_enabling_takes_it_back(stack: Stack) -> None:
    axis = stack.axes[0]
    enabling = asyncio.create_task(axis.enable())
    await until(lambda: axis._drive.being_enabled)
    await axis.stop()
    with pytest.raises(NotReady, match="ended by a stop"):
        await enabling
    await asyncio.sleep(2)
    assert stack.modules[1].module.axes[0].state is PowerState.SWITCHED_ON
    assert axis.status.state is PowerState.SWITCHED_ON
    await axis.enable()
    assert axis.status.state is PowerState.OPERATION_ENABLED


async def test_a_stop_that_a_quick_stop_overtakes_still_returns_at_standstill(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.move_to(MoveRequest(2_000_000))
    await asyncio.sleep(1)
    stop = asyncio.create_task(axis.stop())
    await asyncio.sleep(0.01)
    await axis.quick_stop()
    await stop
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED


async def test_a_write_whose_answer_is_lost_fails_the_move_before_it_begins_and_is_made_anew(
    stack: Stack,
) -> None:
    axis = (await stack.enabled())[0]
    stack.wire.faults.drop(cob_id(0x581), count=1)
    motion = axis.move_to(MoveRequest(1000, velocity=4321))
    await motion.wait(5)
    assert isinstance(motion.error, SdoTimeout)
    assert "unknown" in str(motion.error)
    assert motion.started is None
    await until(lambda: axis.errand is None)
    await stack.node.write(Address(0x6081), 1)
    again = axis.move_to(MoveRequest(1000, velocity=4321))
    await again.wait(5)
    assert again.state is MotionState.SUCCEEDED, again.error
    assert await stack.node.read(Address(0x6081)) == 4321


def _halts(frame: Frame) -> bool:
    return frame.cob_id == 0x201 and frame.data[1] & 1 == 1


async def test_a_stop_gets_through_where_no_halt_does(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    # Every halt is lost, and nothing else: only a quick stop is left.
    stack.wire.faults.drop(_halts)
    with pytest.raises(MotionTimeout, match="quick stop"):
        await axis.stop()
    assert not stack.modules[1].module.axes[0].moving
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED


@pytest.mark.parametrize(("lost", "deceleration", "says", "turns"), [
    (_halts, 100_000, "a quick stop ended it", False),
    (cob_id(0x201), 100_000, "not seen to stand after a quick stop", True),
    (cob_id(), 4_000, "not seen to stand in time", True),  # a ramp longer than the report waits
], ids=["halts", "commands", "nothing"])  # fmt: skip
async def test_a_stop_for_everything_says_stopped_of_no_axis_that_its_halt_did_not_stop(
    stack: Stack, lost: Predicate, deceleration: int, says: str, turns: bool
) -> None:
    axes = await stack.enabled()
    axes[0].move_to(MoveRequest(5_000_000, velocity=60_000, deceleration=deceleration))
    axes[1].move_to(MoveRequest(500_000))
    await asyncio.sleep(2)
    stack.wire.faults.drop(lost)
    report = await stack.network.stop_all("a test")
    assert not report.complete
    assert [(line.axis, line.outcome) for line in report.axes] == [
        (0, StopOutcome.FAILED),
        (1, StopOutcome.STOPPED),
        (2, StopOutcome.STOPPED),
    ]
    assert says in report.axes[0].message
    assert stack.modules[1].module.axes[0].moving is turns


async def test_a_halt_that_was_not_followed_up_is_not_released_into_the_old_set_point(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    mode_0 = stack.wire.faults.drop(lambda frame: frame.cob_id == 0x201 and frame.data[2] == 0)
    with pytest.raises(TransitionTimeout):
        await axis.stop()
    mode_0.end()
    rest = position_of(axis)
    highest = rest
    motion = axis.move_to(MoveRequest(rest - 400))
    while not motion.done:
        await asyncio.sleep(0.005)
        highest = max(highest, position_of(axis))
    assert (motion.state, axis.status.position) == (MotionState.SUCCEEDED, rest - 400), motion.error
    assert highest == rest


async def kept_in_pre_operational(stack: Stack) -> None:
    """Somebody else commands the node to Pre-operational, and our starts don't reach it."""
    stack.wire.faults.drop(lambda frame: frame.cob_id == 0 and frame.data[0] == 1)
    stack.wire.inject(Frame(0x000, bytes([0x80, 1])))
    await until(lambda: stack.node.state is not NodeState.OPERATIONAL)


async def test_a_quick_stop_reaches_a_drive_in_pre_operational_by_sdo(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    await kept_in_pre_operational(stack)
    motor = stack.modules[1].module.axes[0]
    assert motor.moving, "no PDO reaches it"
    await axis.quick_stop()
    assert not motor.moving
    assert motor.state is PowerState.SWITCH_ON_DISABLED
    assert (await stack.node.read(Address(0x6060))) == 0


async def test_a_stop_reaches_a_drive_in_pre_operational_by_sdo(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    await kept_in_pre_operational(stack)
    await axis.stop()
    motor = stack.modules[1].module.axes[0]
    assert not motor.moving
    assert motor.state is PowerState.OPERATION_ENABLED


async def test_an_axis_whose_status_is_late_is_stopped_by_a_disable_but_not_switched_off(
    stack: Stack,
) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    silent = {axis.pdos.status.cob_id, axis.pdos.motion.cob_id}
    stack.wire.faults.drop(lambda frame: frame.cob_id in silent)
    await until(lambda: axis.status.stale)
    with pytest.raises(NotReady, match="too old"):
        await axis.disable()
    motor = stack.modules[1].module.axes[0]
    await until(lambda: not motor.moving)
    assert motor.state is PowerState.OPERATION_ENABLED, "it holds what it carries"


async def test_no_set_point_that_still_waits_has_the_last_word_over_a_stop(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    sent: list[Frame] = []
    await axis.run_at(VelocityRequest(20_000)).wait(10)
    stack.port.hold()
    stack.wire.tap(lambda sender, frame: sent.append(frame) if sender == stack.port.name else None)
    for velocity in (30_000, 40_000, 50_000):
        axis.run_at(VelocityRequest(velocity))
        await asyncio.sleep(0.02)
    stop = asyncio.create_task(axis.stop())
    await asyncio.sleep(0.02)
    stack.port.release()
    await stop
    velocities = [frame.data for frame in sent if frame.cob_id == axis.pdos.velocity.cob_id]
    assert velocities, "the halt in profile velocity mode is an RPDO 3"
    assert all(data == velocities[0] for data in velocities)
    assert velocities[0][2:] == bytes(4)
    assert not stack.modules[1].module.axes[0].moving
