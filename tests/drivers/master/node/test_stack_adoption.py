"""A service that restarts finds its motors running: it adopts them, and changes nothing."""

from __future__ import annotations

import asyncio

import pytest
from stack_kit import AXES, Stack, stack_of, until

from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.objects import Address
from drivers.cia402.modes import Mode
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import NotReady
from drivers.master import (
    Axis,
    AxisConfig,
    HomeRequest,
    Motion,
    MotionState,
    MoveRequest,
    Network,
    Reference,
    VelocityRequest,
)

pytestmark = pytest.mark.looptime

NO_SWITCHES = (AxisConfig(name="x", switch_parameters=3), *AXES[1:])


def start(axis: Axis, mode: Mode) -> Motion:
    """Something that lasts, in this mode."""
    match mode:
        case Mode.PROFILE_POSITION:
            return axis.move_to(MoveRequest(2_000_000))
        case Mode.PROFILE_VELOCITY:
            return axis.run_at(VelocityRequest(30_000))
        case _:
            return axis.home(HomeRequest(method=19, fast=20_000))


def commands(stack: Stack) -> list[Frame]:
    """What a master writes or commands from now on, but for reads and heartbeats."""
    sent: list[Frame] = []

    def note(_: str, frame: Frame) -> None:
        write = frame.cob_id == 0x601 and frame.data[0] >> 5 == 1
        rpdo = frame.cob_id in {pdos.power.cob_id for pdos in stack.network.plan.nodes[1].axes}
        nmt = frame.cob_id == cob.NMT and frame.data[0] != NmtCommand.START
        if write or rpdo or nmt:
            sent.append(frame)

    stack.wire.tap(note)
    return sent


@pytest.mark.parametrize("mode", [Mode.PROFILE_POSITION, Mode.PROFILE_VELOCITY, Mode.HOMING])
async def test_what_runs_is_adopted_goes_on_and_can_be_stopped_then_claimed(mode: Mode) -> None:
    async with stack_of(1, axes=NO_SWITCHES) as stack:
        await stack.enabled()
        start(stack.axes[0], mode)
        await asyncio.sleep(1)
        await stack.master_dies()
        sent = commands(stack)
        module = stack.modules[1].module
        async with Network(stack.port, stack.network.config, Catalog.load()) as second:
            await until(lambda: second.ready)
            assert sent == [], "nothing was written, reset or commanded"
            assert module.axes[0].moving
            axis = second.node(1).axes[0]
            found = axis.status.adopted
            assert found is not None
            assert (found.state, found.mode, found.moving) == (PowerState.OPERATION_ENABLED, mode, True)
            assert found.velocity
            assert "nobody has claimed it" in found.reason
            assert axis.status.reference is Reference.UNKNOWN
            with pytest.raises(NotReady, match="claimed"):
                axis.move_to(MoveRequest(0))
            with pytest.raises(NotReady, match="turns"):
                await axis.enable()
            await axis.stop()
            assert not module.axes[0].moving
            assert axis.adopted, "a stop claims nothing"
            await axis.enable()
            assert axis.status.adopted is None
            motion = axis.move_to(MoveRequest(100, relative=True))
            await until(lambda: motion.done)
            assert motion.state is MotionState.SUCCEEDED, motion.error


@pytest.mark.parametrize(
    ("write", "differs"),
    [("2B 01 18 05 07 00 00 00", Address(0x1801, 5)), ("2F 02 14 02 FE 00 00 00", Address(0x1402, 2))],
    ids=["an event timer", "a transmission type"],
)
async def test_a_node_whose_pdos_must_be_put_right_while_it_turns_never_leaves_operational(
    write: str, differs: Address
) -> None:
    """Outside NMT Operational no module looks for our heartbeat: a motor would outlive its master."""
    async with stack_of(1) as stack:
        axes = await stack.enabled()
        await axes[0].run_at(VelocityRequest(30_000)).wait(10)
        await stack.master_dies()
        stack.wire.inject(Frame(0x601, bytes.fromhex(write)))
        module, states = stack.modules[1].module, set[NmtState]()
        stack.wire.tap(lambda _, frame: states.add(module.nmt_state))
        async with Network(stack.port, stack.network.config, Catalog.load()) as second:
            await until(lambda: second.ready)
            changes = [change.address for step in second.node(1).boot_log.steps for change in step.changes]
            assert differs in changes
            assert module.axes[0].moving
            assert states == {NmtState.OPERATIONAL}
            await second.node(1).axes[0].stop()
            assert not module.axes[0].moving


async def test_a_late_heartbeat_takes_the_claim_of_what_moved(stack: Stack) -> None:
    axes = await stack.enabled()
    axes[0].move_to(MoveRequest(2_000_000))
    await asyncio.sleep(1)
    silence = stack.wire.faults.drop(lambda frame: frame.cob_id == 0x701)
    await until(lambda: stack.node.heartbeat_stale)
    silence.end()
    await until(lambda: not stack.node.heartbeat_stale)
    await until(lambda: axes[0].errand is None)
    assert not axes[0].status.moving
    with pytest.raises(NotReady, match="heartbeat became late"):
        axes[0].move_to(MoveRequest(0))
    assert axes[1].readiness("move") == ()
    await axes[0].enable()
    assert axes[0].readiness("move") == ()
