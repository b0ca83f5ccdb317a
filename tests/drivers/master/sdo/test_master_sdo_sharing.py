"""Equal reads share a transfer, a full queue refuses the least urgent, deadlines hold, stops overtake."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest
from scripted_peer import ScriptedPeer

from drivers.cia301.objects import Address
from drivers.errors import Outcome, SdoAborted, SdoQueueFull, SdoQueueTimeout, SdoTimeout
from drivers.master.ground.timing import Timing
from drivers.master.sdo.queue import SIZE, Priority

pytestmark = pytest.mark.looptime

POSITION = Address(0x6064)
SPEED = Address(0x606C)
TIMING = Timing(sdo_response=0.3, sdo_quarantine=0.25, sdo_queue=2.0)


@pytest.fixture
def peer() -> ScriptedPeer:
    return ScriptedPeer(TIMING)


async def started(call: Coroutine[Any, Any, bytes | None]) -> asyncio.Task[bytes | None]:
    """A task that has come as far as it can without an answer."""
    task = asyncio.create_task(call)
    await asyncio.sleep(0)
    return task


def answer(peer: ScriptedPeer, value: int, address: Address = POSITION) -> None:
    peer.answer(f"43{address.index.to_bytes(2, 'little').hex()}{address.sub:02x}{value:02x}000000")


def requests(peer: ScriptedPeer) -> list[str]:
    """What was asked, aborts left out."""
    return [data[:4].hex() for data in peer.asked if data[0] != 0x80]


async def test_equal_reads_by_onlookers_are_one_transfer(peer: ScriptedPeer) -> None:
    readers = [await started(peer.client.upload(POSITION)) for _ in range(10)]
    answer(peer, 7)
    assert await asyncio.gather(*readers) == [b"\x07\0\0\0"] * 10
    assert len(peer.asked) == 1
    assert peer.client.counters.shared == 9
    assert peer.client.counters.completed == 1


async def test_whoever_decides_by_a_value_gets_one_sampled_after_it_asked(peer: ScriptedPeer) -> None:
    onlooker = await started(peer.client.upload(POSITION))
    deciders = [await started(peer.client.upload(POSITION, priority=Priority.CONTROL)) for _ in range(3)]
    answer(peer, 1)
    answer(peer, 2)
    assert await onlooker == b"\x01\0\0\0"
    assert await asyncio.gather(*deciders) == [b"\x02\0\0\0"] * 3
    assert len(peer.asked) == 2


async def test_no_read_joins_across_a_write(peer: ScriptedPeer) -> None:
    before = await started(peer.client.upload(POSITION))
    write = await started(peer.client.download(POSITION, b"\x09\0\0\0"))
    after = [await started(peer.client.upload(POSITION)) for _ in range(2)]
    answer(peer, 1)
    peer.answer("6064600000000000")
    answer(peer, 9)
    await write
    assert await before == b"\x01\0\0\0"
    assert await asyncio.gather(*after) == [b"\x09\0\0\0"] * 2
    assert [data[0] for data in peer.asked] == [0x40, 0x23, 0x40]


async def test_no_read_joins_across_a_command_by_pdo_or_nmt(peer: ScriptedPeer) -> None:
    before = await started(peer.client.upload(POSITION))
    peer.client.note_command()
    after = await started(peer.client.upload(POSITION))
    answer(peer, 1)
    answer(peer, 2)
    assert (await before, await after) == (b"\x01\0\0\0", b"\x02\0\0\0")


async def test_an_urgent_reader_hastens_the_read_that_it_joins(peer: ScriptedPeer) -> None:
    running = await started(peer.client.upload(Address(0x1000)))
    other = await started(peer.client.upload(SPEED))
    waiting = await started(peer.client.upload(POSITION))
    urgent = await started(peer.client.upload(POSITION, priority=Priority.CONTROL))
    answer(peer, 0, Address(0x1000))
    answer(peer, 5)
    assert (await waiting, await urgent) == (b"\x05\0\0\0", b"\x05\0\0\0")
    answer(peer, 6, SPEED)
    await asyncio.gather(running, other)
    assert requests(peer) == ["40001000", "40646000", "406c6000"]


async def test_an_urgent_reader_does_not_hasten_a_read_past_the_write_that_was_asked_before_it(
    peer: ScriptedPeer,
) -> None:
    running = await started(peer.client.upload(Address(0x1000)))
    write = await started(peer.client.download(POSITION, b"\x09\0\0\0"))
    after = await started(peer.client.upload(POSITION))
    urgent = await started(peer.client.upload(POSITION, priority=Priority.CONTROL))
    answer(peer, 0, Address(0x1000))
    answer(peer, 1)
    peer.answer("6064600000000000")
    answer(peer, 9)
    assert (await urgent, await after) == (b"\x01\0\0\0", b"\x09\0\0\0")
    await asyncio.gather(running, write)


async def test_one_reader_s_cancellation_is_its_own_and_the_last_one_s_ends_the_transfer(
    peer: ScriptedPeer,
) -> None:
    first = await started(peer.client.upload(POSITION))
    second = await started(peer.client.upload(POSITION))
    first.cancel()
    await asyncio.wait([first])
    assert len(peer.asked) == 1
    answer(peer, 3)
    assert await second == b"\x03\0\0\0"
    third = await started(peer.client.upload(POSITION))
    fourth = await started(peer.client.upload(POSITION))
    for task in (third, fourth):
        task.cancel()
    await asyncio.wait([third, fourth])
    assert peer.asked[-1] == bytes.fromhex("8064600000000405")
    assert peer.client.counters.cancelled == 1
    assert peer.client.idle


async def test_a_shared_refusal_reaches_every_reader(peer: ScriptedPeer) -> None:
    readers = [await started(peer.client.upload(POSITION)) for _ in range(3)]
    peer.answer("8064600000000206")
    for reader in readers:
        with pytest.raises(SdoAborted) as refused:
            await reader
        assert refused.value.outcome is Outcome.REFUSED


async def test_a_write_cancelled_at_the_very_moment_of_its_turn_is_not_sent(peer: ScriptedPeer) -> None:
    running = await started(peer.client.upload(POSITION))
    write = await started(peer.client.download(SPEED, b"\x01\0\0\0"))
    write.cancel()
    answer(peer, 1)  # the write's task has not run yet
    assert requests(peer) == ["40646000"]
    await asyncio.wait([running, write])
    assert write.cancelled()
    assert peer.client.idle


async def test_a_full_queue_refuses_the_newest_onlooker_and_never_a_stop(peer: ScriptedPeer) -> None:
    running = await started(peer.client.upload(POSITION))
    onlookers = [await started(peer.client.upload(Address(0x2000 + n))) for n in range(SIZE)]
    assert peer.client.waiting == SIZE
    with pytest.raises(SdoQueueFull) as full:
        await peer.client.upload(SPEED)
    assert full.value.hint
    assert full.value.outcome is Outcome.NOT_SENT
    stop = await started(peer.client.upload(SPEED, priority=Priority.STOP))
    control = await started(peer.client.download(SPEED, b"\1", priority=Priority.CONTROL))
    assert peer.client.waiting == SIZE
    for driven_out in onlookers[-2:]:
        with pytest.raises(SdoQueueFull):
            await driven_out
    assert peer.client.counters.refused == 3
    answer(peer, 1)
    answer(peer, 2, SPEED)
    assert await stop == b"\x02\0\0\0"
    assert requests(peer) == ["40646000", "406c6000", "2f6c6000"]
    rest = [control, *onlookers[:-2], running]
    for task in rest:
        task.cancel()
    await asyncio.wait(rest)
    assert peer.client.idle


async def test_a_full_queue_of_stops_is_full(peer: ScriptedPeer) -> None:
    stops = [
        await started(peer.client.upload(Address(0x2000 + n), priority=Priority.STOP))
        for n in range(SIZE + 1)
    ]
    with pytest.raises(SdoQueueFull):
        await peer.client.upload(SPEED, priority=Priority.STOP)
    for task in stops:
        task.cancel()
    await asyncio.wait(stops)


async def test_a_caller_s_deadline_counts_for_it_alone(peer: ScriptedPeer) -> None:
    loop = asyncio.get_running_loop()
    begun = loop.time()
    patient = await started(peer.client.upload(POSITION))
    hasty = await started(peer.client.upload(POSITION, within=0.1))
    with pytest.raises(SdoTimeout):
        await hasty
    assert loop.time() - begun == pytest.approx(0.1, abs=0.01)
    answer(peer, 4)
    assert await patient == b"\x04\0\0\0"
    assert len(peer.asked) == 1


async def test_a_deadline_ends_a_transfer_that_goes_on_and_on(peer: ScriptedPeer) -> None:
    loop = asyncio.get_running_loop()
    begun = loop.time()
    read = await started(peer.client.upload(Address(0x1008), within=1.0))
    peer.answer("41081000ffff0000")
    toggle = 0
    while not read.done():
        await asyncio.sleep(0.1)
        if not read.done():
            peer.answer(f"{toggle:02x}00000000000000")
            toggle ^= 0x10
    with pytest.raises(SdoTimeout):
        await read
    assert loop.time() - begun == pytest.approx(1.0, abs=0.11)
    assert peer.asked[-1] == bytes.fromhex("8008100000000405")


async def test_a_deadline_in_the_queue_sends_nothing(peer: ScriptedPeer) -> None:
    running = await started(peer.client.upload(POSITION))
    with pytest.raises(SdoQueueTimeout) as late:
        await peer.client.download(SPEED, b"\1", within=0.1)
    assert late.value.outcome is Outcome.NOT_SENT
    answer(peer, 1)
    await running
    assert requests(peer) == ["40646000"]


async def test_a_stop_does_not_wait_for_a_late_answer_that_can_be_told_apart(peer: ScriptedPeer) -> None:
    with pytest.raises(SdoTimeout):
        await peer.client.upload(POSITION)
    looking = await started(peer.client.upload(Address(0x1000)))
    same = await started(peer.client.upload(POSITION, priority=Priority.STOP))
    assert requests(peer) == ["40646000"]
    stop = await started(peer.client.upload(SPEED, priority=Priority.STOP))
    assert requests(peer) == ["40646000"]  # behind the stop that has to wait
    same.cancel()
    await asyncio.wait([same])
    assert requests(peer) == ["40646000", "406c6000"]
    answer(peer, 1)  # late, and told apart
    answer(peer, 2, SPEED)
    assert await stop == b"\x02\0\0\0"
    assert peer.client.counters.foreign == 1
    looking.cancel()
    await asyncio.wait([looking])


async def test_nothing_overtakes_a_silence_after_segments(peer: ScriptedPeer) -> None:
    read = await started(peer.client.upload(Address(0x1008)))
    peer.answer("4108100009000000")
    with pytest.raises(SdoTimeout):
        await read
    stop = await started(peer.client.upload(SPEED, priority=Priority.STOP))
    assert requests(peer) == ["40081000", "60000000"]
    await peer.turn(4)
    answer(peer, 2, SPEED)
    await stop


async def test_an_idle_client_leaves_no_timer_that_works_on(peer: ScriptedPeer) -> None:
    for value in range(3):
        read = await started(peer.client.upload(POSITION))
        answer(peer, value)
        await read
    await asyncio.sleep(5)
    assert peer.client._timer is None


async def test_an_abort_brings_what_the_model_says_to_do(peer: ScriptedPeer) -> None:
    peer = ScriptedPeer(TIMING, remedy=lambda code: f"remedy {code:X}")
    read = await started(peer.client.upload(POSITION))
    peer.answer("8064600000000206")
    with pytest.raises(SdoAborted) as refused:
        await read
    assert refused.value.hint == "remedy 6020000"
