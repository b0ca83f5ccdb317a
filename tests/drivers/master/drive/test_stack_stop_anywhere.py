"""A stop at every instant of every command: standstill, bit 4 low, an honest end, and an axis that goes on.

One stack serves all instants of a command, each from the same start; the clock is virtual.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass

import pytest
from stack_kit import Stack, stack_of, until

from drivers.bus.faults import cob_id
from drivers.cia402 import objects
from drivers.cia402.power import Controlword, PowerState
from drivers.errors import NodeAway, NotReady
from drivers.master import (
    Axis,
    AxisConfig,
    HomeRequest,
    Motion,
    MotionState,
    MoveRequest,
    NodeState,
    VelocityRequest,
)
from drivers.master.plan.requests import OnBusy

pytestmark = pytest.mark.looptime

STANDING = {PowerState.SWITCH_ON_DISABLED, PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON}


def instants() -> Iterator[float]:
    """Dense where the frames of a command follow one another, sparse where nothing but time passes."""
    yield from (tick * 0.00043 for tick in range(14))
    yield from (0.007 + tick * 0.0047 for tick in range(6))
    yield from (0.05, 0.13, 0.26, 0.41, 1.1)


@dataclass(frozen=True)
class Case:
    """A command, the state that it starts from, and those in which a stop may leave the axis."""

    begin: Callable[[Axis], Motion | Awaitable[None]]
    enabled: bool = True
    ends: frozenset[PowerState] = frozenset({PowerState.OPERATION_ENABLED})
    before: Callable[[Axis], Awaitable[object]] | None = None
    fault: bool = False


async def turning(axis: Axis) -> None:
    await axis.run_at(VelocityRequest(60_000)).wait(10)


def replaced(axis: Axis) -> Motion:
    axis.run_at(VelocityRequest(90_000, acceleration=90_000))
    return axis.run_at(VelocityRequest(-20_000))


def put_aside(axis: Axis) -> Motion:
    axis.move_to(MoveRequest(40_000, relative=True))
    return axis.move_to(MoveRequest(-900, relative=True), on_busy=OnBusy.REPLACE)


CASES = {
    "enable": Case(Axis.enable, enabled=False, ends=frozenset({*STANDING, PowerState.OPERATION_ENABLED})),
    "move": Case(lambda axis: axis.move_to(MoveRequest(40_000, relative=True))),
    "short move": Case(lambda axis: axis.move_to(MoveRequest(3, relative=True))),
    "slow ramp": Case(
        lambda axis: axis.move_to(MoveRequest(90_000, relative=True, acceleration=60_000, deceleration=9_000))
    ),
    "homing": Case(lambda axis: axis.home(HomeRequest(method=18, fast=20_000, slow=2_000))),
    "homing here": Case(lambda axis: axis.home(HomeRequest(method=35))),
    "velocity": Case(lambda axis: axis.run_at(VelocityRequest(60_000))),
    "velocity replaced": Case(replaced),
    "velocity changed": Case(lambda axis: axis.run_at(VelocityRequest(-60_000)), before=turning),
    "turning put aside": Case(
        lambda axis: axis.move_to(MoveRequest(-900, relative=True), on_busy=OnBusy.REPLACE), before=turning
    ),
    "move put aside": Case(put_aside),
    "disable": Case(
        Axis.disable,
        ends=frozenset({PowerState.SWITCH_ON_DISABLED, PowerState.OPERATION_ENABLED}),
        before=turning,
    ),
    "reset fault": Case(
        Axis.reset_fault,
        enabled=False,
        ends=frozenset({PowerState.FAULT, PowerState.SWITCH_ON_DISABLED}),
        fault=True,
    ),
}


def in_module(stack: Stack, index: int, axis: int = 0) -> int:
    """An object as the simulated module holds it now."""
    now = asyncio.get_running_loop().time()
    module = stack.modules[1].module
    live = module.axes[axis].read(index, 0, now)
    if live is not None:
        return live
    return module.dictionary.stored(module.profile.spec(index, 0, axis).address)


async def prepare(stack: Stack, case: Case) -> Axis:
    axis = stack.axes[0]
    await axis.stop()
    if case.fault:
        stack.modules[1].apply(lambda module, now: module.axes[0].short("a", now))
        await until(lambda: axis.status.state is PowerState.FAULT)
        stack.modules[1].apply(lambda module, now: module.axes[0].mend(now))
    else:
        await axis.reset_fault()
        await (axis.enable() if case.enabled else axis.disable())
        if case.enabled and in_module(stack, objects.POSITION):
            await axis.move_to(
                MoveRequest(0, velocity=2_000_000, acceleration=9_000_000, deceleration=9_000_000)
            ).wait(9)
    if case.before is not None:
        await case.before(axis)
    return axis


async def begun(case: Case, axis: Axis) -> tuple[Motion | None, asyncio.Task[None] | None]:
    what = case.begin(axis)
    if isinstance(what, Motion):
        return what, None
    return None, asyncio.ensure_future(what)


async def ended(task: asyncio.Task[None] | None) -> None:
    """Whoever gave the command hears of its end, and of nothing but a `CanaxisError`."""
    if task is not None:
        async with asyncio.timeout(10):
            await asyncio.gather(task, return_exceptions=True)
        error = task.exception()
        assert error is None or isinstance(error, NotReady), error


async def stands_for_good(stack: Stack, case: Case, axis: Axis) -> None:
    """What a stop owes, said by the module itself and by the status, then and a while later."""
    state = axis.status.state
    assert state in case.ends
    assert in_module(stack, objects.VELOCITY) == 0
    assert axis.status.velocity == 0
    assert not axis.status.moving
    rest = in_module(stack, objects.POSITION)
    assert axis.status.position == rest
    assert axis.errand is None
    assert axis.motion is None
    await asyncio.sleep(0.4)
    assert in_module(stack, objects.POSITION) == rest
    assert stack.modules[1].module.axes[0].state is axis.status.state is state
    controlword = in_module(stack, objects.CONTROLWORD)
    assert not controlword & (Controlword.NEW_SET_POINT | Controlword.HALT | Controlword.FAULT_RESET)


@pytest.mark.parametrize("name", CASES)
async def test_a_stop_at_any_instant_leaves_the_axis_standing_and_usable(name: str) -> None:
    case = CASES[name]
    async with stack_of(1) as stack:
        await stack.ready()
        for instant in instants():
            axis = await prepare(stack, case)
            motion, task = await begun(case, axis)
            if instant:
                await asyncio.sleep(instant)
            over = motion is not None and motion.done
            await axis.stop()
            if motion is not None:
                assert motion.done
                assert over or motion.state is MotionState.CANCELLED, (instant, motion.error)
            await ended(task)
            try:
                await stands_for_good(stack, case, axis)
            except AssertionError as error:
                raise AssertionError(f"{name}: a stop after {instant:.5f} s: {error}") from error
        axis = await prepare(stack, CASES["move"])
        last = axis.move_to(MoveRequest(1234))
        await last.wait(20)
        assert (last.state, in_module(stack, objects.POSITION)) == (MotionState.SUCCEEDED, 1234), last.error
        assert stack.network.failure is None


@pytest.mark.parametrize("mode_at_once", [False, True])
@pytest.mark.parametrize("name", ["move", "slow ramp", "velocity", "homing"])
async def test_a_stop_returns_at_standstill_though_the_last_status_is_of_the_time_before_the_start(
    stack: Stack, name: str, mode_at_once: bool
) -> None:
    """Whether the module shows mode 0 at standstill only, or at once."""
    motor = stack.modules[1].module.axes[0]
    motor.changes_mode_at_once = mode_at_once
    axis = await prepare(stack, CASES[name])
    statuses = (axis.pdos.status.cob_id, axis.pdos.motion.cob_id)
    silence = stack.wire.faults.drop(lambda frame: frame.cob_id in statuses and motor.moving)
    motion, _ = await begun(CASES[name], axis)
    await until(lambda: motor.moving)
    await asyncio.sleep(0.1)
    assert not axis.status.moving
    assert not axis.status.stale
    stopping = asyncio.create_task(axis.stop())
    await asyncio.sleep(0)
    silence.end()
    await stopping
    assert not motor.moving
    assert motion is not None
    assert motion.state is MotionState.CANCELLED
    await stands_for_good(stack, CASES[name], axis)


async def test_a_stop_for_everything_at_any_instant_stops_three_axes_at_three_things(stack: Stack) -> None:
    for instant in (0.0, 0.0003, 0.0011, 0.0029, 0.006, 0.013, 0.05, 0.31):
        axes = await stack.enabled()
        motions = [
            axes[0].move_to(MoveRequest(20_000, relative=True)),
            axes[1].run_at(VelocityRequest(-40_000)),
            axes[2].home(HomeRequest(method=17)),
        ]
        await asyncio.sleep(instant)
        report = await stack.network.stop_all("a test")
        assert report.complete, report
        assert all(motion.state is MotionState.CANCELLED for motion in motions if motion.error)
        assert all(motion.done for motion in motions)
        rests = [in_module(stack, objects.POSITION, number) for number in range(3)]
        assert [axis.status.position for axis in axes] == rests
        stack.network.reset_stop()
        await asyncio.sleep(0.5)
        assert [in_module(stack, objects.POSITION, number) for number in range(3)] == rests


@pytest.mark.parametrize("name", ["enable", "move", "homing", "velocity", "disable"])
async def test_a_node_that_goes_at_any_instant_ends_the_command_in_bounded_time(name: str) -> None:
    case = CASES[name]
    async with stack_of(1) as stack:
        await stack.ready()
        for instant in (0.0, 0.0004, 0.0013, 0.004, 0.06):
            axis = await prepare(stack, case)
            motion, task = await begun(case, axis)
            await asyncio.sleep(instant)
            stack.modules[1].power_off()
            if motion is not None:
                assert await motion.wait(2), instant
                assert motion.state is MotionState.FAILED
            elif task is not None:
                done, _ = await asyncio.wait({task}, timeout=2)
                assert done, instant
                assert isinstance(task.exception(), NodeAway | None), task.exception()
            await until(lambda: stack.node.state is NodeState.LOST)
            stack.modules[1].power_on()
            await stack.ready()
            assert axis.errand is None
            assert axis.status.state is PowerState.SWITCH_ON_DISABLED


def _heartbeat_late(stack: Stack) -> Awaitable[None]:
    stack.wire.faults.drop(cob_id(0x701), count=2)
    return until(lambda: stack.node.heartbeat_stale)


def _status_late(stack: Stack) -> Awaitable[None]:
    axis = stack.axes[0]
    silence = stack.wire.faults.drop(cob_id(axis.pdos.motion.cob_id))
    asyncio.get_running_loop().call_later(1.0, silence.end)
    return until(lambda: axis.status.stale)


async def _another_stop(stack: Stack) -> None:
    stack.network.latch_stop("a test")


@pytest.mark.parametrize("interrupted_by", [_heartbeat_late, _status_late, _another_stop])
@pytest.mark.parametrize("command", ["stop", "quick_stop", "disable"])
async def test_a_coming_to_rest_goes_on_to_its_end_whatever_interrupts_it(
    command: str, interrupted_by: Callable[[Stack], Awaitable[None]]
) -> None:
    gentle = AxisConfig(name="x", velocity=60_000, deceleration=15_000, quick_stop_deceleration=15_000)
    async with stack_of(1, axes=(gentle,)) as stack:
        axis = (await stack.enabled())[0]
        axis.move_to(MoveRequest(2_000_000))
        await asyncio.sleep(1)
        motor = stack.modules[1].module.axes[0]
        ending = asyncio.create_task(getattr(axis, command)())
        await asyncio.sleep(0.1)
        errand = axis.errand
        await interrupted_by(stack)
        assert motor.moving
        assert axis.errand is errand
        await ending
        assert not motor.moving
        enabled = command == "stop"
        assert motor.state is (PowerState.OPERATION_ENABLED if enabled else PowerState.SWITCH_ON_DISABLED)
        await until(lambda: axis.errand is None)
