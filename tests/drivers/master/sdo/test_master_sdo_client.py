"""The SDO client against a peer that answers late, wrongly, twice or never."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from scripted_peer import ScriptedPeer

from drivers.cia301.objects import Address
from drivers.errors import BusDown, NodeAway, SdoAborted, SdoProtocolError, SdoTimeout
from drivers.master.ground.timing import Timing
from drivers.master.sdo.client import Priority

pytestmark = pytest.mark.looptime

POSITION = Address(0x6064)
TIMING = Timing(sdo_response=0.3, sdo_quarantine=0.25, sdo_queue=2.0)
READ_POSITION = bytes.fromhex("4064600000000000")


@pytest.fixture
def peer() -> ScriptedPeer:
    return ScriptedPeer(TIMING)


async def begin(peer: ScriptedPeer, address: Address = POSITION, **how: Any) -> asyncio.Task[bytes]:
    """Start a read and let its request out."""
    count = len(peer.asked)
    task = asyncio.create_task(peer.client.upload(address, **how))
    await peer.turn(count + 1)
    return task


async def test_an_expedited_read(peer: ScriptedPeer) -> None:
    task = await begin(peer)
    assert peer.asked == [READ_POSITION]
    peer.answer("4364600078563412")
    assert await task == bytes.fromhex("78563412")
    assert peer.client.idle
    assert peer.client.counters.completed == 1


async def test_an_expedited_write(peer: ScriptedPeer) -> None:
    task = asyncio.create_task(peer.client.download(Address(0x6060), b"\x01"))
    await peer.turn()
    assert peer.asked == [bytes.fromhex("2f60600001000000")]
    peer.answer("6060600000000000")
    await task


async def test_a_segmented_read(peer: ScriptedPeer) -> None:
    task = await begin(peer, Address(0x1008))
    peer.answer("4108100009000000")
    peer.answer("00544d434d2d3332")
    peer.answer("1b31360000000000")
    assert await task == b"TMCM-3216"
    assert [data[0] for data in peer.asked] == [0x40, 0x60, 0x70]


async def test_a_wrong_toggle_aborts_and_gives_no_partial_data(peer: ScriptedPeer) -> None:
    task = await begin(peer, Address(0x1008))
    peer.answer("4108100009000000")
    peer.answer("10544d434d2d3332")
    with pytest.raises(SdoProtocolError):
        await task
    assert peer.asked[-1] == bytes.fromhex("8008100000000305")
    assert peer.client.counters.violations == 1


async def test_an_abort_carries_its_code_and_meaning(peer: ScriptedPeer) -> None:
    task = await begin(peer)
    peer.answer("8064600000000206")
    with pytest.raises(SdoAborted) as refused:
        await task
    assert refused.value.abort_code == 0x06020000
    assert refused.value.meaning
    assert (refused.value.node, refused.value.index, refused.value.sub) == (5, 0x6064, 0)


async def test_a_time_out_aborts_on_the_wire_and_then_keeps_silent(peer: ScriptedPeer) -> None:
    loop = asyncio.get_running_loop()
    begun = loop.time()
    first = await begin(peer)
    second = asyncio.create_task(peer.client.upload(Address(0x606C)))
    with pytest.raises(SdoTimeout) as timeout:
        await first
    assert "unknown" not in str(timeout.value)
    assert loop.time() - begun == pytest.approx(0.3, abs=0.01)
    assert peer.asked[-1] == bytes.fromhex("8064600000000405")
    peer.answer("4364600078563412")  # late, and in the quarantine
    await peer.turn(3)
    assert loop.time() - begun == pytest.approx(0.55, abs=0.01)
    peer.answer("436c600001000000")
    assert await second == bytes.fromhex("01000000")
    assert peer.client.counters.late == 1


async def test_a_write_that_times_out_says_that_its_outcome_is_unknown(peer: ScriptedPeer) -> None:
    with pytest.raises(SdoTimeout, match="outcome is unknown"):
        await peer.client.download(Address(0x6081), b"\x01\0\0\0")


async def test_a_foreign_answer_is_dropped_and_the_wait_goes_on(peer: ScriptedPeer) -> None:
    task = await begin(peer)
    peer.answer("436c600001000000")
    peer.answer("606c600000000000")
    peer.answer("4364680002000000")
    peer.answer("4364600003000000")
    assert await task == bytes.fromhex("03000000")
    assert peer.client.counters.foreign == 3


async def test_foreign_answers_do_not_put_the_deadline_off(peer: ScriptedPeer) -> None:
    loop = asyncio.get_running_loop()
    task = await begin(peer)
    begun = loop.time()
    for _ in range(2):
        await asyncio.sleep(0.1)
        peer.answer("436c600001000000")
    with pytest.raises(SdoTimeout):
        await task
    assert loop.time() - begun < 0.31


async def test_a_doubled_answer_is_counted_and_dropped(peer: ScriptedPeer) -> None:
    task = await begin(peer)
    peer.answer("4364600003000000")
    peer.answer("4364600003000000")
    assert await task == bytes.fromhex("03000000")
    assert peer.client.counters.late == 1


@pytest.mark.parametrize("text", ["", "43", "436460000300000000"[:14]])
async def test_answers_of_a_wrong_length_are_counted_and_dropped(peer: ScriptedPeer, text: str) -> None:
    task = await begin(peer)
    peer.answer(text)
    assert peer.client.counters.malformed == 1
    peer.answer("4364600003000000")
    await task


async def test_a_cancelled_caller_leaves_an_abort_and_a_quarantine(peer: ScriptedPeer) -> None:
    loop = asyncio.get_running_loop()
    begun = loop.time()
    task = await begin(peer)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert peer.asked[-1] == bytes.fromhex("8064600000000405")
    following = asyncio.create_task(peer.client.upload(POSITION))
    await asyncio.sleep(0.5)
    peer.answer("43646000ffffffff")  # the answer to the cancelled one, for the very same object
    await peer.turn(3)
    assert loop.time() - begun == pytest.approx(0.55, abs=0.01)  # as after a time-out
    peer.answer("4364600007000000")
    assert await following == bytes.fromhex("07000000")
    assert (peer.client.counters.cancelled, peer.client.counters.late) == (1, 1)


async def test_a_caller_cancelled_in_the_queue_sends_nothing(peer: ScriptedPeer) -> None:
    first = await begin(peer)
    waiting = asyncio.create_task(peer.client.upload(Address(0x606C)))
    await asyncio.sleep(0.01)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    peer.answer("4364600003000000")
    await first
    assert peer.asked == [READ_POSITION]
    assert peer.client.idle


async def test_urgent_transfers_go_first_and_equals_in_order(peer: ScriptedPeer) -> None:
    first = await begin(peer)
    order = [Priority.MONITOR, Priority.CONFIGURE, Priority.STOP, Priority.CONTROL, Priority.STOP]
    tasks = [
        asyncio.create_task(peer.client.upload(Address(0x2000 + number), priority=priority))
        for number, priority in enumerate(order)
    ]
    await asyncio.sleep(0.01)
    peer.answer("4364600003000000")
    await first
    for served in range(len(order)):
        asked = (await peer.turn(served + 2))[-1]
        peer.answer(f"43{asked[1:4].hex()}00000000")
        await asyncio.sleep(0)
    await asyncio.gather(*tasks)
    assert [data[1] for data in peer.asked[1:]] == [2, 4, 3, 1, 0]


async def test_the_queue_has_a_bound(peer: ScriptedPeer) -> None:
    first = await begin(peer)
    waiting = asyncio.create_task(peer.client.upload(Address(0x606C)))
    for _ in range(14):  # keep the first one alive with segments for longer than the queue's patience
        if len(peer.asked) == 1:
            peer.answer("4164600000ff0000")
        else:
            toggle = "00" if len(peer.asked) % 2 == 0 else "10"
            peer.answer(toggle + "00" * 7)
        await asyncio.sleep(0.2)
    with pytest.raises(SdoTimeout, match="nothing was sent"):
        await waiting
    first.cancel()
    with pytest.raises(asyncio.CancelledError):
        await first


async def test_a_bus_that_is_down_is_said_at_once_and_frees_the_channel(peer: ScriptedPeer) -> None:
    peer.down = True
    with pytest.raises(BusDown):
        await peer.client.upload(POSITION)
    peer.down = False
    task = await begin(peer)
    peer.answer("4364600003000000")
    await task


async def test_losing_the_node_ends_everything(peer: ScriptedPeer) -> None:
    first = await begin(peer)
    waiting = asyncio.create_task(peer.client.upload(Address(0x606C)))
    await asyncio.sleep(0.01)
    peer.client.fail_all(NodeAway("gone"))
    for task in (first, waiting):
        with pytest.raises(NodeAway):
            await task
    assert peer.client.idle


async def test_unasked_answers_are_counted(peer: ScriptedPeer) -> None:
    peer.answer("4364600003000000")
    assert peer.client.counters.late == 1
