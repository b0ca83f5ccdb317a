"""What goes wrong between the master and a module, and what the user gets."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

import pytest
from stack_kit import Stack, stack_of, until

from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.nmt import NmtCommand, NmtState, encode
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import (
    AxisBusy,
    AxisFault,
    BusDown,
    BusOverflow,
    CanaxisError,
    GuardedObject,
    NodeAway,
    NotReady,
    SdoTimeout,
)
from drivers.master import (
    Axis,
    AxisCommand,
    Failsafe,
    HomeRequest,
    Motion,
    MotionState,
    MoveRequest,
    Network,
    NodeState,
    StopOutcome,
    VelocityRequest,
)

pytestmark = pytest.mark.looptime


async def test_a_node_switched_off_in_mid_move_fails_the_move_and_is_lost(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.modules[1].power_off()
    await motion.wait(5)
    assert motion.state is MotionState.FAILED
    assert isinstance(motion.error, NodeAway)
    await until(lambda: stack.node.state is NodeState.LOST)
    with pytest.raises(NodeAway, match="lost"):
        axis.move_to(MoveRequest(0))
    with pytest.raises(NodeAway, match="unknown"):
        await axis.stop()
    report = await stack.network.stop_all("test")
    assert {line.outcome for line in report.axes} == {StopOutcome.UNREACHABLE}


async def test_a_node_that_comes_back_is_taken_in_but_never_enabled(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    stack.modules[1].power_off()
    await until(lambda: stack.node.state is NodeState.LOST)
    stack.modules[1].power_on()
    await stack.ready()
    await asyncio.sleep(1)
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED
    await axis.enable()
    await axis.move_to(MoveRequest(100)).wait(10)
    assert axis.status.position == 100


async def test_a_restart_in_mid_move_is_a_fault_and_loses_the_reference(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.home(HomeRequest(method=35)).wait(10)
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.modules[1].power_cycle()
    await motion.wait(5)
    assert motion.state is MotionState.FAILED
    assert "restarted" in str(motion.error)
    await stack.ready()
    await until(lambda: not axis.status.stale)
    assert not axis.status.referenced
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED
    assert stack.node.failsafe is Failsafe.UNVERIFIED
    await axis.enable()
    again = axis.move_to(MoveRequest(1000))
    await again.wait(10)
    assert again.state is MotionState.SUCCEEDED, again.error


async def test_a_node_that_comes_late_is_taken_in() -> None:
    async with stack_of(configured=(1,)) as stack:
        await asyncio.sleep(7)
        assert stack.node.state is NodeState.ABSENT
        with pytest.raises(NodeAway, match="absent"):
            await stack.axes[0].enable()
        async with stack.add_module(1):
            await stack.ready()
            assert stack.network.ready
            await stack.axes[0].enable()
            assert stack.axes[0].status.state is PowerState.OPERATION_ENABLED
            await stack.network.close()


async def test_something_else_under_the_id_is_refused_and_not_written_to() -> None:
    async with stack_of(configured=(1,)) as stack:
        module = stack.add_module(1)
        stack.wire.faults.corrupt(
            lambda frame: frame._replace(data=frame.data[:4] + (3214).to_bytes(4, "little")),
            lambda frame: frame.cob_id == 0x581 and frame.data[:4] == bytes.fromhex("43181002"),
        )
        writes: list[Frame] = []
        stack.wire.tap(
            lambda name, frame: (
                writes.append(frame) if frame.cob_id == 0x601 and frame.data[0] >> 5 == 1 else None
            )
        )
        async with module:
            await until(lambda: stack.node.state is NodeState.REFUSED)
            assert "TMCM-3216" in stack.node.reason
            assert writes == []
            with pytest.raises(GuardedObject, match="refused"):
                await stack.node.write(Address(0x2003), 10)
            await stack.network.close()


async def test_a_lost_heartbeat_stops_the_motion_and_coming_back_clears_nothing(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    silence = stack.wire.faults.drop(cob_id(0x701))
    await motion.wait(2)
    assert motion.state is MotionState.FAILED
    assert "heartbeat" in str(motion.error)
    assert stack.node.heartbeat_stale
    assert axis.readiness(AxisCommand.MOVE)[0].code == "heartbeat_stale"
    await until(lambda: not stack.modules[1].module.axes[0].moving)
    await until(lambda: stack.node.state is NodeState.LOST)
    silence.end()
    await stack.ready()
    assert axis.adopted
    with pytest.raises(NotReady, match="claimed"):
        axis.move_to(MoveRequest(0))
    await axis.enable()
    back = axis.move_to(MoveRequest(0))
    await back.wait(20)
    assert axis.status.position == 0


async def test_without_our_heartbeat_the_module_stops_its_motors(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.wire.faults.drop(cob_id(0x77F))
    await motion.wait(5)
    assert motion.state is MotionState.FAILED
    module = stack.modules[1].module
    await until(lambda: module.axes[0].state is PowerState.FAULT)
    assert not module.axes[0].moving
    assert 0x8130 in [record.code for record in stack.node.emergencies]


async def test_a_master_that_restarts_adopts_what_turns() -> None:
    async with stack_of(1) as stack:
        axis = (await stack.enabled())[0]
        await axis.run_at(VelocityRequest(30_000)).wait(10)
        config = stack.network.config
        await stack.master_dies()
        async with Network(stack.port, config, Catalog.load()) as second:
            node = second.node(1)
            await until(lambda: node.state is NodeState.OPERATIONAL)
            adopted = node.axes[0]
            assert [a.adopted for a in node.axes] == [True, True, True]
            assert adopted.status.moving
            assert adopted.status.velocity == 30_000
            with pytest.raises(NotReady, match="claimed"):
                adopted.run_at(VelocityRequest(0))
            with pytest.raises(NotReady, match="turns"):
                await adopted.enable()
            await adopted.stop()
            assert not adopted.status.moving
            await adopted.enable()
            assert not adopted.adopted
            motion = adopted.move_to(MoveRequest(0))
            await motion.wait(20)
            assert motion.state is MotionState.SUCCEEDED, motion.error


async def test_an_emergency_fails_the_motion_with_its_meaning(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    other = stack.axes[1].move_to(MoveRequest(30_000))
    await asyncio.sleep(1)
    stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
    await motion.wait(5)
    assert isinstance(motion.error, AxisFault)
    assert "2312" in str(motion.error)
    await until(lambda: axis.status.state is PowerState.FAULT)
    assert axis.status.emergencies
    assert stack.axes[1].status.emergencies == ()
    await other.wait(10)
    assert other.state is MotionState.SUCCEEDED


async def test_an_emergency_that_comes_behind_the_fault_explains_it_all_the_same(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    stack.wire.faults.delay(cob_id(cob.emcy(1)), 0.09)
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
    await until(lambda: axis.status.state is PowerState.FAULT)
    assert axis.status.emergencies == ()
    await motion.wait(5)
    assert isinstance(motion.error, AxisFault)
    assert "2312" in motion.error.message
    assert axis.status.emergencies[0].remedy in motion.error.hint


async def test_a_fault_that_no_emergency_explains_is_not_waited_on_for_long(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    stack.wire.faults.drop(cob_id(cob.emcy(1)))
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
    assert await motion.wait(0.3)
    assert isinstance(motion.error, AxisFault)
    assert "no emergency names the cause" in motion.error.message


async def test_a_fault_is_reset_on_purpose_and_does_not_enable(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
    await until(lambda: axis.status.state is PowerState.FAULT)
    with pytest.raises(NotReady, match="fault"):
        await axis.enable()
    stack.modules[1].apply(lambda module, now: module.axes[0].mend(now))
    await axis.reset_fault()
    assert axis.status.state is PowerState.SWITCH_ON_DISABLED
    assert axis.status.emergencies == ()
    await axis.enable()
    await axis.move_to(MoveRequest(500)).wait(10)
    assert axis.status.position == 500


async def test_a_fault_reset_waits_for_the_ramp_down(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stopping = asyncio.create_task(axis.stop())
    await asyncio.sleep(0.05)
    with pytest.raises(AxisBusy, match="being stopped"):
        await axis.enable()
    await axis.reset_fault()
    assert stopping.done()
    assert axis.status.state is PowerState.OPERATION_ENABLED


async def test_two_nodes_work_in_parallel_and_one_s_trouble_is_its_own() -> None:
    async with stack_of(1, 2) as stack:
        await stack.ready()
        first, second = stack.network.node(1).axes[2], stack.network.node(2).axes[2]
        await asyncio.gather(first.enable(), second.enable())
        one, two = first.move_to(MoveRequest(300_000)), second.move_to(MoveRequest(40_000))
        await asyncio.sleep(0.5)
        stack.modules[1].power_off()
        await asyncio.gather(one.wait(10), two.wait(10))
        assert one.state is MotionState.FAILED
        assert two.state is MotionState.SUCCEEDED, two.error
        assert second.status.position == 40_000


async def test_an_absent_node_delays_no_other() -> None:
    async with stack_of(1, configured=(1, 5, 9)) as stack:
        await stack.ready(1)
        assert asyncio.get_running_loop().time() < 2
        assert not stack.network.ready


async def test_a_lost_answer_is_a_timeout_and_the_next_read_is_right(stack: Stack) -> None:
    stack.wire.faults.drop(cob_id(0x581), count=2)
    with pytest.raises(SdoTimeout):
        await stack.node.read(Address(0x1008))
    assert await stack.node.read(Address(0x1008)) == "TMCM-3216"


async def test_an_answer_that_comes_too_late_is_not_taken_for_another(stack: Stack) -> None:
    stack.wire.faults.delay(lambda f: f.cob_id == 0x581, 0.4, count=1)
    with pytest.raises(SdoTimeout):
        await stack.node.write(Address(0x2000), 7)
    assert await stack.node.read(Address(0x2200)) == 8
    assert stack.node.counters.sdo.late == 1


async def test_the_unplugged_adapter_loses_the_nodes_and_a_replug_takes_them_in(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.port.unplug()
    assert motion.state is MotionState.FAILED
    assert stack.node.state is NodeState.LOST
    with pytest.raises(BusDown, match="unknown"):
        axis.move_to(MoveRequest(0))
    await until(lambda: stack.modules[1].module.axes[0].state is PowerState.FAULT)
    stack.port.plug()
    await stack.ready()
    assert axis.status.state is PowerState.FAULT
    await axis.reset_fault()
    await axis.enable()
    again = axis.move_to(MoveRequest(0))
    await again.wait(20)
    assert again.state is MotionState.SUCCEEDED, again.error


async def test_somebody_else_s_nmt_command_fails_the_motion(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.wire.inject(Frame(cob.NMT, encode(NmtCommand.STOP, 1)))
    await motion.wait(5)
    assert motion.state is MotionState.FAILED
    await until(lambda: axis.status.state is PowerState.FAULT)
    await stack.ready()
    assert stack.node.nmt_state is NmtState.OPERATIONAL


async def test_a_node_found_in_nmt_stopped_is_woken_and_not_reset() -> None:
    async with stack_of(configured=(1,)) as stack:
        await asyncio.sleep(0.1)
        async with stack.add_module(1) as module:
            stack.wire.inject(Frame(cob.NMT, encode(NmtCommand.STOP, 1)))
            await stack.ready()
            assert stack.node.counters.boot_ups == 1
            assert module.module.nmt_state is NmtState.OPERATIONAL
            await stack.network.close()


async def test_a_borrowed_id_that_shows_up_blocks_the_borrower(stack: Stack) -> None:
    donor = stack.network.plan.nodes[1].donors[0]
    stack.wire.inject(Frame(cob.heartbeat(donor), b"\x05"))
    assert stack.node.state is NodeState.REFUSED
    assert str(donor) in stack.node.reason
    assert stack.network.bus_status().warnings


async def test_an_axis_of_a_blocked_node_can_still_be_stopped(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.run_at(VelocityRequest(30_000)).wait(10)
    stack.wire.inject(Frame(cob.heartbeat(stack.network.plan.nodes[1].donors[0]), b"\x05"))
    await axis.stop()
    module = stack.modules[1].module
    assert module.axes[0].state is PowerState.OPERATION_ENABLED
    await until(lambda: not module.axes[0].moving)


async def test_two_nodes_with_one_id_are_noticed_and_not_written_to() -> None:
    async with stack_of(configured=(1,)) as stack:
        stack.wire.faults.duplicate(cob_id(0x581))
        async with stack.add_module(1):
            await until(lambda: stack.node.state is NodeState.DUPLICATE)
            assert "two nodes" in stack.node.reason
            with pytest.raises(NodeAway, match="duplicate"):
                await stack.axes[0].enable()
            await stack.network.close()


@pytest.mark.parametrize("shown_by", ["its boot-up", "its answers"])
async def test_what_turns_is_halted_when_a_second_node_has_its_id(stack: Stack, shown_by: str) -> None:
    axes = await stack.enabled()
    move = axes[0].move_to(MoveRequest(2_000_000))
    await axes[1].run_at(VelocityRequest(30_000)).wait(10)
    first, second = stack.modules[1].module, stack.add_module(1)
    second.faults.no_boot_up = shown_by == "its answers"
    async with second:
        with contextlib.suppress(CanaxisError):
            while shown_by == "its answers":
                await stack.node.read(Address(0x1000))
                await stack.node.read(Address(0x1001))
        await until(lambda: stack.node.state is NodeState.DUPLICATE, 2)
        assert move.state is MotionState.FAILED
        await until(lambda: not any(axis.moving for axis in first.axes), 2)
        assert first.axes[0].state is PowerState.OPERATION_ENABLED, (
            "a halt, not what the module does by itself"
        )
        await stack.network.close()


async def test_what_turns_is_halted_where_a_master_that_restarts_finds_two_nodes_with_its_id() -> None:
    async with stack_of(1) as stack:
        axes = await stack.enabled()
        await axes[0].run_at(VelocityRequest(30_000)).wait(10)
        await stack.master_dies()
        first, second = stack.modules[1].module, stack.add_module(1)
        async with second, Network(stack.port, stack.network.config, Catalog.load()) as restarted:
            await until(lambda: restarted.node(1).state is NodeState.DUPLICATE, 2)
            await until(lambda: not first.axes[0].moving, 2)
            assert first.axes[0].state is PowerState.OPERATION_ENABLED


async def test_another_master_with_our_id_is_told(stack: Stack) -> None:
    subscription = stack.network.events.subscribe()
    stack.wire.inject(Frame(cob.heartbeat(127), b"\x05"))
    assert "our own ID" in stack.network.bus_status().warnings[0]
    told = subscription.take()
    assert told is not None
    assert told.kind == "bus"


@pytest.mark.parametrize("begin", [
    lambda axis: axis.move_to(MoveRequest(500_000)),
    lambda axis: axis.run_at(VelocityRequest(30_000)),
    lambda axis: axis.home(HomeRequest(method=17)),
], ids=["move", "velocity", "homing"])  # fmt: skip
@pytest.mark.parametrize("command", ["stop", "quick_stop", "disable"])
async def test_what_ends_a_motion_goes_past_all_that_waits_in_a_full_transmit_queue(
    stack: Stack, begin: Callable[[Axis], Motion], command: str
) -> None:
    axis = (await stack.enabled())[0]
    begin(axis)
    await asyncio.sleep(1)
    stack.port.hold()
    with contextlib.suppress(BusOverflow):
        while True:
            stack.port.send(Frame(0x7E5, bytes(8)))
    sent: list[int] = []
    stack.wire.tap(lambda sender, frame: sent.append(frame.cob_id) if sender == stack.port.name else None)
    ending = asyncio.create_task(getattr(axis, command)())
    await asyncio.sleep(0.01)
    stack.port.release()
    await ending
    commands = (axis.pdos.power.cob_id, axis.pdos.velocity.cob_id)
    assert sent.count(0x7E5) > 200
    assert min(sent.index(one) for one in commands if one in sent) < sent.index(0x7E5)
    assert not stack.modules[1].module.axes[0].moving


async def test_foreign_and_broken_frames_are_counted_and_change_nothing(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    before = axis.status.position
    status_id = axis.pdos.status.cob_id
    stack.wire.inject(
        Frame(status_id, b"\x37"),
        Frame(status_id, b"\xff" * 8, error=True),
        Frame(status_id, b"", remote=True),
        Frame(0x701, b"\x05\x00"),
        Frame(0x081, b"\x00"),
        Frame(0x581, b"\x60"),
        Frame(0x7FF, b"\x00"),
    )
    counters = stack.network.counters
    assert (counters.error_frames, counters.remote_frames, counters.unrouted) == (1, 1, 1)
    node = stack.node.counters
    assert (node.short_pdos, node.malformed_heartbeats, node.malformed_emergencies) == (1, 1, 1)
    assert node.sdo.malformed == 1
    assert axis.status.position == before
    assert stack.network.failure is None


async def test_lost_power_commands_and_halts_are_repeated(stack: Stack) -> None:
    axis = stack.axes[0]
    stack.wire.faults.drop(cob_id(axis.pdos.power.cob_id), count=2)
    await axis.enable()
    assert axis.status.state is PowerState.OPERATION_ENABLED
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.wire.faults.drop(cob_id(axis.pdos.power.cob_id), count=3)
    await axis.stop()
    assert not stack.modules[1].module.axes[0].moving
    assert motion.state is MotionState.CANCELLED


async def test_a_lost_set_point_is_never_sent_again(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    stack.wire.faults.drop(
        lambda f: f.cob_id == axis.pdos.position.cob_id and bool(f.data[0] & 0x10), count=1
    )
    motion = axis.move_to(MoveRequest(1000))
    await motion.wait(20)
    assert motion.state is MotionState.FAILED
    assert "did not take the set point" in str(motion.error)
    await asyncio.sleep(5)
    assert axis.status.position == 0


async def test_guarded_objects_need_a_confirmation_and_disabled_axes(stack: Stack) -> None:
    node = stack.node
    for address in (Address(0x6040), Address(0x6860), Address(0x7040)):
        with pytest.raises(GuardedObject, match="never"):
            await node.write(address, 0, confirm=True)
    with pytest.raises(GuardedObject, match="Writing 2205h:0"):
        await node.write(Address(0x2205), 3)
    await stack.axes[2].enable()
    with pytest.raises(GuardedObject, match="disabled"):
        await node.write(Address(0x2205), 3, confirm=True)
    await stack.axes[2].disable()
    await node.write(Address(0x2205), 3, confirm=True)
    assert await node.read(Address(0x2205)) == 3


async def test_what_is_written_past_the_commands_does_not_spoil_the_next_move(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    await axis.move_to(MoveRequest(100)).wait(10)
    await stack.node.write(Address(0x6081), 1)
    motion = axis.move_to(MoveRequest(10_000))
    await motion.wait(10)
    assert motion.state is MotionState.SUCCEEDED, motion.error


async def test_a_bug_stops_the_axes_and_is_told(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.network._on_bug(RuntimeError("a bug"))
    assert "a bug" in str(await stack.network.failed())
    assert motion.state is MotionState.CANCELLED
    await until(lambda: not axis.status.moving)
    assert stack.network.stop_latched is not None
