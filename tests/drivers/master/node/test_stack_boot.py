"""Boot-up in the manner of CiA 302: compared first, only the differences written, every outcome told."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from stack_kit import AXES, Stack, stack_of, until

from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.nmt import NmtCommand, NmtState, encode
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.errors import BusDown, ConfigurationRefused, NodeAway, NotReady, WrongIdentity
from drivers.master import AxisConfig, Failsafe, HomeRequest, MotionState, MoveRequest, NodeState, Reference
from drivers.master.seen.boot_log import BootStep, BootStepName, StepState

pytestmark = pytest.mark.looptime


def steps(stack: Stack) -> dict[str, BootStep]:
    return {step.name.value: step for step in stack.node.status().boot}


@contextmanager
def heard(stack: Stack, *identifiers: int) -> Iterator[list[Frame]]:
    """The frames with these identifiers, while it lasts."""
    frames: list[Frame] = []
    end = stack.wire.tap(lambda _, frame: frames.append(frame) if frame.cob_id in identifiers else None)
    yield frames
    end()


def writes(frames: list[Frame]) -> list[Address]:
    """What SDO downloads are about."""
    downloads = [frame.data for frame in frames if frame.cob_id == 0x601 and frame.data[0] >> 5 == 1]
    return [Address(int.from_bytes(data[1:3], "little"), data[3]) for data in downloads]


async def test_every_step_of_a_fresh_module_is_told_with_what_was_written(stack: Stack) -> None:
    found = steps(stack)
    assert list(found) == [name.value for name in BootStepName]
    assert {step.state for step in found.values()} == {StepState.DONE}
    assert all(step.took_s is not None and not step.reason for step in found.values())
    beats = {change.address: (change.old, change.new, change.unit) for change in found["heartbeats"].changes}
    assert beats[Address(0x1017)] == (0, 500, "ms")
    assert beats[Address(0x1029, 1)][:2] == (0, 2)
    parameters = {change.address: change for change in found["parameters"].changes}
    speed = parameters[Address(0x6881)]
    assert (speed.old, speed.new, speed.axis, speed.unit) == (0, 51_200, 1, "steps/s")
    assert Address(0x605A) not in parameters, "2 is its default already"
    assert 0 < found["parameters"].written < found["parameters"].compared
    assert 0 < found["pdos"].written < found["pdos"].compared
    assert all(change.new != change.old for step in found.values() for change in step.changes)


async def test_a_module_that_holds_everything_is_only_read_and_never_leaves_operational(stack: Stack) -> None:
    with heard(stack, 0x601, cob.NMT) as frames:
        await stack.node.boot()
    assert stack.node.state is NodeState.OPERATIONAL
    assert writes(frames) == []
    assert {frame.data[0] for frame in frames if frame.cob_id == cob.NMT} <= {NmtCommand.START}
    assert sum(step.written for step in steps(stack).values()) == 0
    assert stack.modules[1].module.nmt_state is NmtState.OPERATIONAL


async def test_only_what_somebody_changed_is_written(stack: Stack) -> None:
    await stack.node.write(Address(0x6081), 1)
    record, timer = Address(0x1800, 1), Address(0x1800, 5)
    await stack.node.write(record, 0xC000_0181, confirm=True)
    await stack.node.write(timer, 7, confirm=True)
    with heard(stack, 0x601) as frames:
        await stack.node.boot()
    assert writes(frames) == [Address(0x6081), timer, record]
    found = steps(stack)
    assert [(c.address, c.old, c.new) for c in found["parameters"].changes] == [(Address(0x6081), 1, 51_200)]
    assert [(c.address, c.old, c.new) for c in found["pdos"].changes] == [
        (timer, 7, 100),
        (record, 0xC000_0181, 0x4000_0181),
    ]
    assert not stack.axes[0].status.stale


async def test_taking_in_anew_needs_idle_and_disabled_axes(stack: Stack) -> None:
    await stack.axes[1].enable()
    with pytest.raises(NotReady, match="y is operation_enabled"):
        await stack.node.boot()
    assert stack.node.state is NodeState.OPERATIONAL
    await stack.axes[1].disable()
    await stack.node.boot()
    assert stack.axes[1].status.state is PowerState.SWITCH_ON_DISABLED


async def test_a_failed_step_names_reason_and_remedy_and_a_try_now_waits_for_nothing() -> None:
    async with stack_of(configured=(1,)) as stack:
        with pytest.raises(NodeAway, match="does not answer"):
            await stack.node.boot()
        refusal = stack.wire.faults.corrupt(
            lambda frame: frame._replace(data=frame.data[:4] + bytes(4)),
            lambda frame: frame.cob_id == 0x581 and frame.data[:4] == bytes.fromhex("43181002"),
        )
        async with stack.add_module(1):
            await until(lambda: stack.node.state is NodeState.REFUSED)
            step = steps(stack)["identity"]
            assert step.state is StepState.FAILED
            assert "TMCM-3216" in step.reason
            assert "connect the configured module" in step.remedy
            assert steps(stack)["axes"].state is StepState.PENDING
            with pytest.raises(WrongIdentity):
                await stack.node.boot()
            refusal.end()
            begun = asyncio.get_running_loop().time()
            await stack.node.boot()
            assert asyncio.get_running_loop().time() - begun < 1
            assert stack.node.state is NodeState.OPERATIONAL
            await stack.network.close()


async def test_a_value_that_reads_back_differently_fails_its_step() -> None:
    async with stack_of(configured=(1,)) as stack:
        stack.wire.faults.corrupt(
            lambda frame: frame._replace(data=frame.data[:4] + b"\x01\x00\x00\x00"),
            lambda frame: (
                frame.cob_id == 0x581 and frame.data[1:4] == b"\x83\x60\x00" and frame.data[0] == 0x43
            ),
        )
        async with stack.add_module(1):
            await until(lambda: stack.node.state is NodeState.REFUSED)
            step = steps(stack)["parameters"]
            assert step.state is StepState.FAILED
            assert "holds 1 in 6083h:0" in step.reason
            assert "second master" in step.remedy
            with pytest.raises(ConfigurationRefused):
                await stack.node.boot()
            await stack.network.close()


async def test_a_bus_that_is_gone_says_so_to_a_try_now(stack: Stack) -> None:
    stack.port.unplug()
    with pytest.raises((NodeAway, BusDown)):
        await stack.node.boot()
    stack.port.plug()
    await stack.ready()


async def test_a_module_that_takes_no_1029h_is_configured_with_its_failsafe_off() -> None:
    async with stack_of(configured=(1,)) as stack:
        refusing = bytes.fromhex("80 29 10 01 30 00 09 06")
        stack.wire.faults.corrupt(
            lambda frame: frame._replace(data=refusing),
            lambda frame: frame.cob_id == 0x581 and frame.data[1:4] == b"\x29\x10\x01",
        )
        async with stack.add_module(1):
            await stack.ready(1)
            assert stack.node.failsafe is Failsafe.OFF
            assert "off" in steps(stack)["heartbeats"].note
            with pytest.raises(NotReady, match="1029h:1"):
                await stack.axes[0].enable()
            await stack.network.close()


async def test_a_node_that_resets_itself_is_brought_back_with_its_reference_lost(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    assert axis.status.reference is Reference.UNKNOWN
    await axis.home(HomeRequest(method=35)).wait(10)
    assert axis.status.reference is Reference.HOMED
    motion = axis.move_to(MoveRequest(500_000))
    await asyncio.sleep(1)
    stack.modules[1].power_cycle()
    await motion.wait(5)
    assert motion.state is MotionState.FAILED
    await until(lambda: stack.node.state is not NodeState.OPERATIONAL)
    await stack.ready()
    await asyncio.sleep(2)
    assert {one.status.reference for one in stack.axes} == {Reference.LOST}
    assert {one.status.state for one in stack.axes} == {PowerState.SWITCH_ON_DISABLED}
    assert not any(one.adopted for one in stack.axes)
    assert steps(stack)["parameters"].written
    with pytest.raises(NotReady, match="switch_on_disabled"):
        axis.move_to(MoveRequest(1, relative=True))


async def test_a_failed_homing_loses_the_reference() -> None:
    async with stack_of(1, axes=(AxisConfig(name="x", switch_parameters=3), *AXES[1:])) as stack:
        axis = (await stack.enabled())[0]
        await axis.home(HomeRequest(method=35)).wait(10)
        seeking = axis.home(HomeRequest(method=19))
        await until(lambda: axis.status.moving)
        await axis.stop()
        assert seeking.state is MotionState.CANCELLED
        assert (axis.status.reference, axis.status.referenced) == (Reference.LOST, False)


async def test_a_lost_start_is_sent_again() -> None:
    async with stack_of(configured=(1,)) as stack:
        lost = stack.wire.faults.drop(
            lambda frame: frame.cob_id == cob.NMT and frame.data[0] == NmtCommand.START, count=1
        )
        async with stack.add_module(1):
            await stack.ready(1)
            assert lost.hits == 1
            await stack.network.close()


async def test_a_heartbeat_of_before_the_start_that_comes_late_is_no_news(stack: Stack) -> None:
    await stack.node.boot()
    stack.wire.inject(Frame(0x701, b"\x7f"))
    assert stack.node.state is NodeState.OPERATIONAL
    await asyncio.sleep(0.3)
    stack.wire.inject(Frame(0x701, b"\x7f"))
    assert stack.node.state is NodeState.BOOTED
    await stack.ready()


async def test_a_heartbeat_that_never_comes_after_the_start_is_missed(stack: Stack) -> None:
    stack.wire.faults.drop(cob_id(0x701))
    await stack.node.boot()
    await until(lambda: stack.node.heartbeat_stale, 2)
    await until(lambda: stack.node.state is NodeState.LOST, 2)


async def test_the_boot_up_needs_no_heartbeat_period(stack: Stack) -> None:
    stack.modules[1].power_off()
    await until(lambda: stack.node.state is NodeState.LOST)
    stack.modules[1].power_on()
    begun = asyncio.get_running_loop().time()
    await stack.ready()
    assert asyncio.get_running_loop().time() - begun < 1  # a probe that it did not hear is waited for
    assert sum(step.took_s or 0 for step in stack.node.status().boot) < 0.3


async def test_a_node_found_in_nmt_stopped_tells_so_in_its_axes(stack: Stack) -> None:
    await stack.axes[0].enable()
    stack.wire.inject(Frame(cob.NMT, encode(NmtCommand.STOP, 1)))
    await until(lambda: stack.node.state is not NodeState.OPERATIONAL)
    await stack.ready()
    assert "x: fault" in steps(stack)["axes"].note
