"""Inputs and outputs of a module through the master, and waiting for an input."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from stack_kit import Stack, result_of, stack_of, until

from drivers.cia301 import cob
from drivers.cia301.objects import Address
from drivers.errors import (
    BadValue,
    ConfigurationRefused,
    InputTimeout,
    NodeAway,
    NotReady,
    StopLatched,
    UnknownTerminal,
)
from drivers.master import MotionState, MoveRequest
from drivers.master.node.conditions import POLL, analog, digital
from drivers.master.node.io import IO_MODE, OUTPUT_LEVELS, OUTPUT_MASK
from drivers.master.node.waiting import MOST

pytestmark = pytest.mark.looptime


def apply(stack: Stack, terminal: int, *, on: bool) -> None:
    stack.modules[1].apply(lambda module, _: module.terminals.apply(terminal, on))


def set_analog(stack: Stack, terminal: int, value: int) -> None:
    stack.modules[1].apply(lambda module, _: module.terminals.set_analog(terminal, value))


def driven(stack: Stack) -> list[bool]:
    return [stack.modules[1].module.terminals.output(terminal) for terminal in range(4)]


async def with_outputs(stack: Stack, mode: int = 0b1111) -> None:
    await stack.ready()
    await stack.node.write(IO_MODE, mode, confirm=True)


def requests(stack: Stack) -> int:
    return stack.node.counters.sdo.requests


# --- inputs ---


async def test_inputs_are_what_is_applied(stack: Stack) -> None:
    apply(stack, 1, on=True)
    apply(stack, 3, on=True)
    set_analog(stack, 0, 7)
    set_analog(stack, 1, 4095)
    levels = await stack.node.terminals.digital_levels()
    assert [(level.number, level.name, level.on) for level in levels] == [
        (0, "IN0", False),
        (1, "IN1", True),
        (2, "IN2", False),
        (3, "IN3", True),
    ]
    found = await stack.node.terminals.analog_levels()
    assert [(level.number, level.name, level.raw, level.volts) for level in found] == [
        (0, "AIN0", 7, None),
        (1, "AIN1", 4095, None),
    ]


async def test_readers_at_the_same_time_share_the_transfers(stack: Stack) -> None:
    before = requests(stack)
    levels = await asyncio.gather(*(stack.node.terminals.digital_levels() for _ in range(50)))
    assert len(set(levels)) == 1
    assert requests(stack) - before <= 2


async def test_nothing_is_asked_of_a_node_that_is_away() -> None:
    async with stack_of(configured=(1,)) as stack:
        for ask in (
            stack.node.terminals.digital_levels,
            stack.node.terminals.analog_levels,
            stack.node.terminals.output_levels,
        ):
            with pytest.raises(NodeAway):
                await ask()
        with pytest.raises(NodeAway):
            await stack.node.terminals.switch(0, on=False)
        with pytest.raises(NodeAway):
            stack.node.waits.begin(digital(stack.node, 0, becomes=True), 1)


# --- outputs ---


async def test_an_output_is_switched_and_the_others_are_left_alone(stack: Stack) -> None:
    await with_outputs(stack, 0b0100_0000_1111)
    output = await stack.node.terminals.switch(2, on=True)
    assert (output.number, output.name, output.on, output.usable, output.push_pull) == (
        2, "OUT2", True, True, True,
    )  # fmt: skip
    assert driven(stack) == [False, False, True, False]
    await stack.node.terminals.switch(0, on=True)
    assert driven(stack) == [True, False, True, False]
    await stack.node.terminals.switch(2, on=False)
    assert driven(stack) == [True, False, False, False]
    assert [output.on for output in await stack.node.terminals.output_levels()] == driven(stack)


async def test_outputs_that_are_switched_at_once_don_t_undo_each_other(stack: Stack) -> None:
    await with_outputs(stack)
    await asyncio.gather(*(stack.node.terminals.switch(number, on=True) for number in (0, 1, 3)))
    assert driven(stack) == [True, True, False, True]


async def test_an_input_is_no_output(stack: Stack) -> None:
    await with_outputs(stack, 0b0001)
    with pytest.raises(NotReady) as refused:
        await stack.node.terminals.switch(1, on=True)
    assert [obstacle.code for obstacle in refused.value.obstacles] == ["not_an_output"]
    assert await stack.node.read(OUTPUT_LEVELS) == 0


@pytest.mark.parametrize("sub", [1, 2])
async def test_an_output_that_may_hold_a_brake_is_left_to_it(stack: Stack, sub: int) -> None:
    await with_outputs(stack)
    await stack.node.write(Address(0x200C + 0x200, sub), 100, confirm=True)
    with pytest.raises(NotReady, match="brake of axis y") as refused:
        await stack.node.terminals.switch(0, on=False)
    assert [obstacle.code for obstacle in refused.value.obstacles] == ["used_by_brake"]
    assert (await stack.node.read(OUTPUT_LEVELS), await stack.node.read(OUTPUT_MASK)) == (0, 0)


async def test_while_everything_is_stopped_outputs_go_off_only(stack: Stack) -> None:
    await with_outputs(stack)
    await stack.node.terminals.switch(0, on=True)
    await stack.network.stop_all("Enough.")
    with pytest.raises(StopLatched):
        await stack.node.terminals.switch(1, on=True)
    await stack.node.terminals.switch(0, on=False)
    assert driven(stack) == [False] * 4


async def test_a_stop_that_comes_while_it_is_looked_whether_an_output_is_free_comes_first(
    stack: Stack,
) -> None:
    await with_outputs(stack)
    switching = asyncio.create_task(stack.node.terminals.switch(0, on=True))
    await asyncio.sleep(0.001)
    stack.network.latch_stop("Enough.")
    with pytest.raises(StopLatched):
        await switching
    assert driven(stack) == [False] * 4


async def test_an_output_that_another_master_takes_back_is_told(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    await with_outputs(stack)
    held = stack.node.objects.read_int

    async def meddled(address: Address, **options: Any) -> int:
        value = await held(address, **options)
        return 0 if address == OUTPUT_LEVELS else value

    monkeypatch.setattr(stack.node.objects, "read_int", meddled)
    with pytest.raises(ConfigurationRefused, match="OUT1 on"):
        await stack.node.terminals.switch(1, on=True)


async def test_outputs_have_numbers_and_names(stack: Stack) -> None:
    terminals = stack.node.terminals
    assert [terminals.find_output(ref) for ref in (2, "2", "OUT2", "output_2")] == [2] * 4
    with pytest.raises(UnknownTerminal) as refused:
        terminals.find_output("OUT4")
    assert "OUT0, OUT1, OUT2, OUT3" in refused.value.hint


# --- waiting ---


@pytest.mark.parametrize("ref", [1, "IN1"])
async def test_a_wait_succeeds_when_the_input_changes(stack: Stack, ref: int | str) -> None:
    wait = stack.node.waits.begin(digital(stack.node, ref, becomes=True), 30)
    await asyncio.sleep(2)
    assert wait.state is MotionState.RUNNING
    apply(stack, 1, on=True)
    assert await wait.wait(2 * POLL)
    assert wait.state is MotionState.SUCCEEDED, wait.error
    assert result_of(wait)["on"] is True
    assert 2 <= result_of(wait)["waited_s"] <= 2 + 2 * POLL
    off = stack.node.waits.begin(digital(stack.node, ref, becomes=False), 30)
    assert not await off.wait(1)
    apply(stack, 1, on=False)
    assert await off.wait(2 * POLL)


async def test_what_is_so_already_is_seen_at_once(stack: Stack) -> None:
    wait = stack.node.waits.begin(digital(stack.node, 0, becomes=False), 30)
    assert await wait.wait(0.02)
    assert wait.state is MotionState.SUCCEEDED


@pytest.mark.parametrize(
    ("bound", "before", "after"), [({"above": 2000.0}, 2000, 2001), ({"below": 100.0}, 100, 99)]
)
async def test_an_analog_input_passes_a_value(
    stack: Stack, bound: dict[str, float], before: int, after: int
) -> None:
    set_analog(stack, 1, before)
    wait = stack.node.waits.begin(analog(stack.node, 1, **({"above": None, "below": None} | bound)), 30)
    assert not await wait.wait(1)
    set_analog(stack, 1, after)
    assert await wait.wait(2 * POLL)
    assert wait.result is not None
    assert wait.result["raw"] == after


async def test_a_wait_that_sees_nothing_ends_in_time(stack: Stack) -> None:
    wait = stack.node.waits.begin(digital(stack.node, 0, becomes=True), 1.5)
    assert not await wait.wait(1.49)
    assert await wait.wait(0.02)
    assert wait.state is MotionState.FAILED
    assert isinstance(wait.error, InputTimeout)


async def test_a_home_switch_is_waited_for_without_a_question(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    before = requests(stack)
    wait = stack.node.waits.begin(digital(stack.node, "x.positive_limit", becomes=True), 60)
    await asyncio.sleep(5)
    assert requests(stack) == before
    move = axis.move_to(MoveRequest(1_000_000, velocity=1_000_000, acceleration=5_000_000))
    assert await wait.wait(30)
    assert wait.state is MotionState.SUCCEEDED, wait.error
    assert axis.status.switches.positive_limit
    await move.wait(30)


async def test_a_wait_is_cancelled_and_stops_no_axis(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    wait = stack.node.waits.begin(digital(stack.node, 0, becomes=True), 60)
    move = axis.move_to(MoveRequest(100_000))
    await asyncio.sleep(0.3)
    await wait.cancel()
    assert wait.state is MotionState.CANCELLED
    assert wait.error is not None
    assert wait.error.message.startswith("The wait was cancelled")
    assert not move.done
    await move.wait(30)
    assert move.state is MotionState.SUCCEEDED, move.error


async def test_a_stop_ends_no_wait(stack: Stack) -> None:
    wait = stack.node.waits.begin(digital(stack.node, 0, becomes=True), 60)
    await stack.network.stop_all("Enough.")
    assert not wait.done
    apply(stack, 0, on=True)
    assert await wait.wait(1)


@pytest.mark.parametrize("how", ["power_off", "reset"])
async def test_a_wait_whose_node_goes_away_fails(stack: Stack, how: str) -> None:
    waits = [stack.node.waits.begin(digital(stack.node, ref, becomes=True), 3000) for ref in (0, "x.home")]
    if how == "reset":
        stack.modules[1].power_cycle()
    else:
        stack.modules[1].power_off()
    for wait in waits:
        assert await wait.wait(10)
        assert wait.state is MotionState.FAILED
        assert isinstance(wait.error, NodeAway), wait.error


async def test_an_answer_that_is_lost_ends_no_wait(stack: Stack) -> None:
    wait = stack.node.waits.begin(digital(stack.node, 0, becomes=True), 60)
    lost = stack.wire.faults.drop(lambda frame: frame.cob_id == cob.sdo_response(1))
    await asyncio.sleep(1.2)
    lost.end()
    apply(stack, 0, on=True)
    assert await wait.wait(3)
    assert wait.state is MotionState.SUCCEEDED, wait.error


async def test_many_waits_cost_one_question_each_time_and_hold_up_no_move(stack: Stack) -> None:
    axis = (await stack.enabled())[0]
    alone = axis.move_to(MoveRequest(20_000))
    began = asyncio.get_running_loop().time()
    await alone.wait(30)
    took = asyncio.get_running_loop().time() - began
    waits = [stack.node.waits.begin(digital(stack.node, 2, becomes=True), 60) for _ in range(MOST)]
    with pytest.raises(NotReady) as refused:
        stack.node.waits.begin(digital(stack.node, 2, becomes=True), 60)
    assert [obstacle.code for obstacle in refused.value.obstacles] == ["too_many_waits"]
    before = requests(stack)
    await asyncio.sleep(2)
    assert requests(stack) - before <= 2 / POLL + 2
    began = asyncio.get_running_loop().time()
    await axis.move_to(MoveRequest(0)).wait(30)
    assert asyncio.get_running_loop().time() - began <= took + 0.02
    apply(stack, 2, on=True)
    await until(lambda: all(wait.done for wait in waits))


async def test_what_can_t_be_waited_for_is_refused(stack: Stack) -> None:
    node = stack.node
    with pytest.raises(BadValue) as refused:
        digital(node, "IN4", becomes=True)
    assert "IN0" in refused.value.hint
    assert "z.home" in refused.value.hint
    for number, above, below in ((2, 1.0, None), (-1, 1.0, None), (0, 4095.0, None), (0, None, 0.0)):
        with pytest.raises(BadValue):
            analog(node, number, above=above, below=below)
    for seconds in (0.0, 3601.0):
        with pytest.raises(BadValue):
            node.waits.begin(digital(node, 0, becomes=True), seconds)


async def test_the_end_of_the_network_ends_a_wait() -> None:
    async with stack_of(1) as stack:
        await stack.ready()
        wait = stack.node.waits.begin(digital(stack.node, 0, becomes=True), 60)
    assert wait.state is MotionState.CANCELLED
