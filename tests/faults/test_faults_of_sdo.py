"""Object transfers that get no answer, a refusal, or somebody else's answer."""

from __future__ import annotations

import asyncio

import pytest
from api_bench import Bench, running
from fault_kit import FAR, SDO_ANSWER, SDO_REQUEST, Written, metric, refusal, sent_to, truly_moving

from app.configuration.configuration import Configuration
from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia301.objects import Address
from drivers.master.sdo.queue import SIZE, Priority

pytestmark = pytest.mark.looptime

WRITABLE = Configuration.model_validate({"objects": {"writable": True}})
NAME, VENDOR, SPEED = "0x1008/0", "0x1018/1", "0x6081/0"


def counter(name: str) -> str:
    return f'canaxis_node_sdo_{name}_total{{node="1"}}'


async def test_an_unanswered_read_is_504_and_the_next_one_is_right(bench: Bench) -> None:
    silence = bench.wire.faults.drop(cob_id(SDO_ANSWER))
    response = await bench.get(f"/nodes/1/objects/{NAME}")
    assert refusal(response) == (504, "sdo_timeout")
    assert (response.json()["index"], response.json()["sub"]) == ("0x1008", 0)
    silence.end()
    assert (await bench.get(f"/nodes/1/objects/{NAME}")).json()["value"] == "TMCM-3216"
    assert await metric(bench, counter("timeouts")) >= 1


async def test_an_unanswered_write_is_504_with_an_unknown_outcome_and_sent_once() -> None:
    async with running(WRITABLE) as bench:
        await bench.until_ready()
        written = Written(bench)
        silence = bench.wire.faults.drop(cob_id(SDO_ANSWER))
        response = await bench.put(f"/nodes/1/objects/{SPEED}", {"value": 777})
        assert refusal(response) == (504, "sdo_timeout")
        assert response.json()["outcome"] == "unknown"
        assert "unknown" in response.json()["detail"]
        assert "read" in response.json()["hint"].lower()
        silence.end()
        await asyncio.sleep(5)
        assert written.addresses == [Address(0x6081)], "never replayed"
        assert (await bench.get(f"/nodes/1/objects/{SPEED}")).json()["value"] == 777


async def test_a_move_whose_parameters_get_no_answer_fails_and_is_not_begun(bench: Bench) -> None:
    await bench.enable()
    written = Written(bench)
    bench.wire.faults.drop(cob_id(SDO_ANSWER), count=1)
    set_points = sent_to(bench, bench.service.network.node(1).axis(0).pdos.position.cob_id)
    failed = (await bench.move(1000, relative=True, velocity=4321, wait=30)).json()
    assert (failed["state"], failed["error"]["code"], failed["error"]["status"]) == (
        "failed",
        "sdo_timeout",
        504,
    )
    assert "unknown" in failed["error"]["detail"]
    assert failed["started"] is None
    await asyncio.sleep(5)
    assert written.addresses.count(Address(0x6081)) == 1
    assert not any(frame.data[0] & 0x10 for frame in set_points), "no set point was ever given"
    assert not truly_moving(bench)


async def test_a_refused_transfer_says_which_object_which_code_and_what_it_means(bench: Bench) -> None:
    refused = b"\x80\x08\x10\x00" + (0x08000021).to_bytes(4, "little")
    bench.wire.faults.corrupt(lambda frame: frame._replace(data=refused), cob_id(SDO_ANSWER), 1)
    response = await bench.get(f"/nodes/1/objects/{NAME}")
    assert refusal(response)[0] in (409, 502)
    problem = response.json()
    assert problem["code"] == "sdo_aborted"
    assert (problem["index"], problem["sub"], problem["abort_code"]) == ("0x1008", 0, "0x08000021")
    assert "local control" in problem["abort_meaning"]
    assert problem["outcome"] == "refused"
    assert await metric(bench, counter("aborted_by_node")) >= 1


async def test_a_late_answer_is_counted_and_not_taken_for_another(bench: Bench) -> None:
    bench.wire.faults.delay(cob_id(SDO_ANSWER), 0.5, count=2)  # those to a read, and to its one repetition
    refused = await bench.get(f"/nodes/1/objects/{VENDOR}")
    assert refusal(refused) == (504, "sdo_timeout")
    assert (await bench.get("/nodes/1/objects/0x1018/2")).json()["value"] == 3216
    assert (await bench.get(f"/nodes/1/objects/{NAME}")).json()["value"] == "TMCM-3216"
    assert sum([await metric(bench, counter(name)) for name in ("late", "foreign")]) == 2


async def test_doubled_answers_are_counted_and_harmless(bench: Bench) -> None:
    bench.wire.faults.duplicate(cob_id(SDO_ANSWER), count=3)
    for sub, value in ((1, 0x286), (2, 3216), (1, 0x286)):
        assert (await bench.get(f"/nodes/1/objects/0x1018/{sub}")).json()["value"] == value
    counted = [await metric(bench, counter(name)) for name in ("late", "foreign")]
    assert sum(counted) == 3


async def test_a_foreign_answer_is_counted_and_dropped(bench: Bench) -> None:
    """Another master reads the same node: the answers to it reach us too."""
    foreign = Frame(SDO_ANSWER, bytes.fromhex("43 18 10 02 EF BE AD DE"))

    def slip_in(_: str, frame: Frame) -> None:
        if frame.cob_id == SDO_REQUEST:
            bench.wire.inject(foreign)

    bench.wire.tap(slip_in)
    assert (await bench.get(f"/nodes/1/objects/{VENDOR}")).json()["value"] == 0x286
    assert (await bench.get(f"/nodes/1/objects/{NAME}")).json()["value"] == "TMCM-3216"
    assert await metric(bench, counter("foreign")) >= 1


async def test_a_second_master_is_not_taken_for_a_second_node(bench: Bench) -> None:
    """It asks the node in between each of our own requests; every answer reaches both."""
    await bench.enable()
    operation = (await bench.move(FAR)).json()
    for _ in range(30):
        bench.wire.inject(Frame(SDO_REQUEST, bytes.fromhex("40 18 10 01 00 00 00 00")))
        assert (await bench.get("/nodes/1/objects/0x1018/2")).json()["value"] == 3216
    assert (await bench.get("/nodes/1")).json()["state"] == "operational"
    assert (await bench.get(f"/operations/{operation['id']}")).json()["state"] == "running"
    assert await metric(bench, 'canaxis_node_foreign_requests_total{node="1"}') == 30
    assert sum([await metric(bench, counter(name)) for name in ("late", "foreign")]) == 30


async def test_a_wrong_toggle_aborts_the_transfer_and_gives_no_partial_data(bench: Bench) -> None:
    requests = sent_to(bench, SDO_REQUEST)
    bench.wire.faults.corrupt(
        lambda frame: frame._replace(data=bytes([frame.data[0] ^ 0x10]) + frame.data[1:]),
        lambda frame: frame.cob_id == SDO_ANSWER and frame.data[0] >> 5 == 0,
        1,
    )
    response = await bench.get(f"/nodes/1/objects/{NAME}")
    assert refusal(response) == (502, "sdo_protocol")
    assert "TMCM" not in response.text
    await asyncio.sleep(0.01)  # the time that the wire takes
    assert requests[-1].data == b"\x80\x08\x10\x00" + (0x05030000).to_bytes(4, "little")
    assert (await bench.get(f"/nodes/1/objects/{NAME}")).json()["value"] == "TMCM-3216"


async def test_a_cancelled_read_does_not_poison_the_next(bench: Bench) -> None:
    bench.wire.faults.delay(cob_id(SDO_ANSWER), 0.1, count=1)
    node = bench.service.network.node(1)
    reading = asyncio.create_task(node.read(Address(0x1018, 2)))
    await asyncio.sleep(0.05)
    reading.cancel()
    await asyncio.gather(reading, return_exceptions=True)
    assert (await bench.get(f"/nodes/1/objects/{VENDOR}")).json()["value"] == 0x286


async def test_a_full_queue_is_503_with_a_time_to_wait_and_a_stop_finds_room(bench: Bench) -> None:
    node = bench.service.network.node(1)
    objects = [spec.address for spec in node.profile.objects.values() if spec.access.readable]
    silence = bench.wire.faults.drop(cob_id(SDO_ANSWER))
    waiting = [asyncio.create_task(node.read(address)) for address in objects[: SIZE + 1]]
    await asyncio.sleep(0)
    assert f'canaxis_node_sdo_waiting{{node="1"}} {SIZE}.0' in (await bench.client.get("/metrics")).text
    response = await bench.get(f"/nodes/1/objects/{SPEED}")
    assert refusal(response) == (503, "sdo_queue_full")
    assert response.json()["outcome"] == "not_sent"
    assert int(response.headers["retry-after"]) >= 1
    assert await metric(bench, counter("refused")) == 1
    silence.end()
    urgent = node.objects.read(Address(0x606C), priority=Priority.STOP)
    assert await asyncio.wait_for(urgent, 1) == 0
    for task in waiting:
        task.cancel()
    await asyncio.gather(*waiting, return_exceptions=True)


async def test_readers_of_one_object_at_one_time_share_a_transfer(bench: Bench) -> None:
    requests = sent_to(bench, SDO_REQUEST)
    answers = await asyncio.gather(*(bench.get(f"/nodes/1/objects/{VENDOR}") for _ in range(8)))
    assert [answer.json()["value"] for answer in answers] == [0x286] * 8
    assert len(requests) < 8
    assert await metric(bench, counter("shared")) == 8 - len(requests)


@pytest.mark.parametrize("index", ["0x1010/1", "0x1011/1"])
async def test_storing_in_the_module_is_refused_while_an_axis_is_enabled(index: str) -> None:
    async with running(WRITABLE) as bench:
        await bench.until_ready()
        await bench.enable("2")
        written = Written(bench)
        body = {"value": 0x65766173, "confirm": True}
        assert refusal(await bench.put(f"/nodes/1/objects/{index}", body)) == (409, "guarded_object")
        assert written.addresses == []
        assert refusal(await bench.put(f"/nodes/1/objects/{index}", body | {"confirm": False})) == (
            409, "guarded_object",
        )  # fmt: skip
        await bench.post("/nodes/1/axes/2/disable")
        answer = await bench.put("/nodes/1/objects/0x1010/1", body)
        assert answer.status_code == 200, answer.text
