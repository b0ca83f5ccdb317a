"""Whatever a wire brings, in whatever state a node is: the master counts it, and moves nothing by itself."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, fields

import pytest
from fuzz_frames import frames_near
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from stack_kit import Stack, stack_of, until
from virtual_clock import virtual_loop

from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia402.power import Command, Controlword, PowerState, command_of
from drivers.errors import CanaxisError
from drivers.master import NodeState
from drivers.master.ground.counters import NetworkCounters

DONORS = (126, 125)
"""Whose PDO identifiers the further axes of node 1 borrow."""
COB_IDS = (
    *(cob.emcy(1), cob.heartbeat(1), cob.sdo_response(1), cob.sdo_request(1)),
    *(cob.tpdo(number, node) for number in (1, 2) for node in (1, *DONORS)),
    *(cob.heartbeat(node) for node in (*DONORS, 127, 5)),
    *(cob.NMT, cob.SYNC, cob.LSS_RESPONSE, cob.rpdo(1, 1)),
)
PHASES = (Phase.explicit, Phase.reuse, Phase.generate)
"""Shrinking would take minutes."""
MAY_WAIT = 4096
"""No part of a master may hold more things than this because of what a wire brought."""


@dataclass(frozen=True)
class Burst:
    """Frames in one batch, and how long the wire is quiet afterwards."""

    frames: list[Frame]
    quiet: float


bursts = st.lists(
    st.builds(
        Burst,
        st.lists(frames_near(COB_IDS), min_size=1, max_size=25),
        st.sampled_from((0.0, 0.0, 0.0005, 0.003, 0.05, 0.4, 2.0)),
    ),
    max_size=6,
)
situations = st.sampled_from(("absent", "booting", "operational", "enabled"))


class Unasked:
    """What the master sent a drive that might start it: nobody gave a command, so there must be nothing.

    A stop may hold a drive in OPERATION_ENABLED that says it is there, or says nothing readable after it was
    brought there by a command (`by_command`), with bit 4 low.
    """

    def __init__(self, stack: Stack, *, by_command: bool) -> None:
        self.frames: list[Frame] = []
        power = {axis.pdos.power.cob_id: axis for axis in stack.axes}
        send = stack.port.send

        def watched(frame: Frame, *, urgent: bool = False, answered: bool = True) -> None:
            axis = power.get(frame.cob_id)
            if axis is not None:
                word = int.from_bytes(frame.data[:2], "little")
                state = axis.status.state
                holds = state is PowerState.OPERATION_ENABLED or (state is None and by_command)
                starts = command_of(word) is Command.ENABLE_OPERATION and not holds
                if starts or word & Controlword.NEW_SET_POINT:
                    self.frames.append(frame)
            elif frame.cob_id == cob.sdo_request(1) and frame.data[0] >> 5 == 1:
                index = int.from_bytes(frame.data[1:3], "little")
                word = int.from_bytes(frame.data[4:6], "little")
                if index in (0x6040, 0x6840, 0x7040) and word & Controlword.NEW_SET_POINT:
                    self.frames.append(frame)
            send(frame, urgent=urgent, answered=answered)

        stack.port.send = watched


def consistent(stack: Stack) -> None:
    """Every frame is counted once: by the router, and by whoever it was handed to."""
    network, node = stack.network.counters, stack.node.counters
    sdo = node.sdo
    odd = network.error_frames + network.extended_frames + network.remote_frames + network.unrouted
    routed = network.received - odd
    assert routed >= 0
    pdos = node.pdos + node.short_pdos
    told = node.heartbeats + node.boot_ups + node.malformed_heartbeats
    emergencies = node.emergencies + node.malformed_emergencies
    assert pdos + told + emergencies <= routed
    assert sdo.completed + sdo.aborted_by_node + sdo.timeouts + sdo.cancelled + sdo.violations <= sdo.requests
    assert all(getattr(network, field.name) >= 0 for field in fields(NetworkCounters))


def bounded(stack: Stack) -> None:
    """Nothing grows with what comes."""
    assert len(stack.node.emergencies) <= MAY_WAIT
    assert len(stack.node.status().emergencies) <= MAY_WAIT
    assert len(stack.network.bus_status().warnings) <= MAY_WAIT
    assert len(asyncio.all_tasks()) < 50


async def play(situation: str, program: list[Burst]) -> None:
    present = (1,) if situation != "absent" else ()
    async with stack_of(*present, configured=(1,)) as stack:
        if situation == "enabled":
            await stack.enabled()
        elif situation == "operational":
            await stack.ready()
        elif situation == "booting":
            await until(lambda: stack.node.state is not NodeState.ABSENT)
        unasked = Unasked(stack, by_command=situation == "enabled")
        for burst in program:
            stack.wire.inject(*burst.frames)
            consistent(stack)
            await asyncio.sleep(burst.quiet)
            consistent(stack)
            bounded(stack)
            assert stack.network.failure is None, repr(stack.network.failure)
        assert not unasked.frames
        assert all(
            not module.module.axes[axis].moving for module in stack.modules.values() for axis in range(3)
        )
        if present:
            await recovers(stack)
        assert stack.network.failure is None


async def recovers(stack: Stack) -> None:
    """The wire is quiet again: the node comes back, or says what a person must put right."""
    for module in stack.modules.values():
        module.power_cycle()
    await asyncio.sleep(1)  # its boot-up has come, and what was about to be lost is lost
    settled = (NodeState.OPERATIONAL, NodeState.REFUSED, NodeState.DUPLICATE)
    await until(lambda: stack.node.state in settled, 60)
    if stack.node.state is not NodeState.OPERATIONAL:
        assert stack.node.reason
        return
    await until(lambda: not any(axis.status.stale for axis in stack.axes), 10)
    try:
        await stack.axes[0].enable()
    except CanaxisError as error:
        raise AssertionError(f"the axis can't be enabled afterwards: {error.message}") from error


@pytest.mark.timeout(180)
@settings(max_examples=12, deadline=None, phases=PHASES, suppress_health_check=[HealthCheck.too_slow])
@given(situations, bursts)
@example("enabled", [Burst([Frame(cob.tpdo(1, 1), b"\x27\x16\x01")], 0.4)])
@example(
    "operational",
    [Burst([Frame(cob.tpdo(1, 1), b"\x37\x12\x01\0\0\0\0"), Frame(cob.heartbeat(126), b"\x05")], 0.4)],
)
@example("operational", [Burst([Frame(cob.heartbeat(1), b"\x00")] * 20, 0.003)])
def test_no_frames_break_a_master(situation: str, program: list[Burst]) -> None:
    with asyncio.Runner(loop_factory=virtual_loop) as runner:
        runner.run(play(situation, program))
