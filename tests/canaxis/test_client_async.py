"""`AsyncClient` on a service in this process, on a virtual clock; lost answers move nothing twice."""

from __future__ import annotations

import asyncio
import inspect

import httpx
import pytest
from api_bench import URL, Bench, running

import canaxis
from canaxis import (
    AsyncClient,
    AxisFault,
    Conflict,
    InputTimeout,
    NodeAway,
    OperationCancelled,
    PreconditionFailed,
    UnknownPosition,
    UnknownTerminal,
    WaitTimeout,
)
from drivers.sim.terminals import MODE as IO_MODE

pytestmark = pytest.mark.looptime


class Lossy(httpx.ASGITransport):
    """Loses the answers to the next `lose` commands, after the service has carried them out."""

    lose = 0

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        response = await super().handle_async_request(request)
        if request.method != "GET" and self.lose > 0:
            self.lose -= 1
            raise httpx.ReadError("the cable was pulled", request=request)
        return response


def over(transport: httpx.ASGITransport) -> AsyncClient:
    return AsyncClient(URL, http=httpx.AsyncClient(transport=transport))


async def test_from_enabling_to_the_end_of_a_move(bench: Bench) -> None:
    client = over(httpx.ASGITransport(bench.app))
    axis = client.node("stage").axis("x")
    assert (await axis.enable()).state == "operation_enabled"
    move = await axis.move(200_000, "steps")
    with pytest.raises(WaitTimeout, match="goes on"):
        await move.wait(timeout=0.5)
    assert move.state == "running"
    await move.wait()
    assert (await axis.status()).position == move.evidence.axes[0].end
    assert move.error is None
    await axis.disable()


async def test_a_cancelled_operation_says_so_to_who_waits(bench: Bench) -> None:
    client = over(httpx.ASGITransport(bench.app))
    axis = client.node(1).axis(0)
    await axis.enable()
    move = await axis.move(10_000_000, "steps")
    waiting = asyncio.create_task(move.wait())
    await bench.until_moving()
    assert (await (await client.operation(move.id)).cancel()).state == "cancelled"
    with pytest.raises(OperationCancelled):
        await waiting


async def test_a_motion_that_fails_raises_what_it_failed_with(bench: Bench) -> None:
    client = over(httpx.ASGITransport(bench.app))
    axis = client.node(1).axis(0)
    await axis.enable()
    move = await axis.move(10_000_000, "steps")
    await bench.until_moving()
    bench.module.apply(lambda module, at: module.axes[0].supply(5.0, at))
    with pytest.raises(AxisFault, match="Undervoltage") as failed:
        await move.wait()
    assert "supply" in failed.value.hint
    assert move.state == "failed"
    assert [emergency.title for emergency in move.evidence.emergencies] == ["Undervoltage"]
    with pytest.raises(Conflict):  # NotReady, or Busy while it is being stopped
        await axis.move(0, "steps")


@pytest.mark.parametrize("lost", [1, 3])
async def test_a_move_whose_answer_is_lost_is_carried_out_once(bench: Bench, lost: int) -> None:
    transport = Lossy(bench.app)
    client = over(transport)
    axis = client.node(1).axis(0)
    await axis.enable()
    transport.lose = lost
    move = await axis.move(20_000, "steps", relative=True)
    await move.wait()
    position = (await axis.status()).position
    assert position is not None
    assert position.steps == 20_000
    assert [operation.id for operation in await client.operations()] == [move.id]
    assert transport.lose == 0


async def test_an_own_key_is_one_command_also_from_another_client(bench: Bench) -> None:
    ids: set[str] = set()
    for _ in range(2):
        axis = over(httpx.ASGITransport(bench.app)).node(1).axis(0)
        await axis.enable()
        ids.add((await (await axis.move(500, "steps", relative=True, key="well-A1")).wait()).id)
    assert len(ids) == 1


async def test_a_module_that_is_away_is_an_answer_and_no_reason_to_ask_again() -> None:
    async with running(powered=False) as bench:
        client = over(httpx.ASGITransport(bench.app))
        ready = await client.ready()
        assert not ready.ready
        assert "absent" in ready.reasons[0]
        with pytest.raises(NodeAway) as away:
            await client.node("stage").axis("x").enable()
        assert (away.value.status, away.value.code) == (503, "node_away")


@pytest.mark.parametrize("name", ["Client", "Lease", "Node", "Axis", "Operation", "Jog"])
def test_both_clients_say_the_same(name: str) -> None:
    one, other = getattr(canaxis, name), getattr(canaxis, f"Async{name}")
    public = {each for each in dir(one) if not each.startswith("_")}
    assert public == {each for each in dir(other) if not each.startswith("_")}
    for each in public:
        plain, awaited = getattr(one, each), getattr(other, each)
        assert inspect.getdoc(awaited) == (inspect.getdoc(plain) or "").replace("`Client", "`AsyncClient")
        if callable(plain):
            wanted, got = (list(inspect.signature(f).parameters.values()) for f in (plain, awaited))
            assert [(p.name, p.kind, p.default) for p in got] == [(p.name, p.kind, p.default) for p in wanted]


async def test_positions_have_names_and_places_numbers(bench: Bench) -> None:
    axis = over(httpx.ASGITransport(bench.app)).node("stage").axis("y")
    await (await axis.set_position(500, "steps")).wait(timeout=20)
    assert (await axis.status()).referenced
    assert (await axis.teach("here")).position.steps == 500
    assert (await axis.teach("there", position=900, unit="steps")).within_limits
    assert [position.name for position in await axis.positions()] == ["here", "there"]
    await axis.enable()
    gone = await (await axis.go("there", velocity=20_000, unit="steps")).wait(timeout=20)
    assert gone.status.request["position"] == "there"
    assert (await axis.forget_position("here")).position.steps == 500
    with pytest.raises(UnknownPosition):
        await axis.go("here")
    await axis.disable()


async def test_settings_are_changed_from_what_was_seen(bench: Bench) -> None:
    transport = Lossy(bench.app)
    axis = over(transport).node("stage").axis("x")
    seen = await axis.settings()
    assert seen.etag
    transport.lose = 1
    changed = await axis.configure({"velocity": {"value": 70_000, "unit": "steps/s"}}, seen)
    assert (changed.settings["velocity"]["value"], changed.sources["velocity"]) == (70_000, "revision")
    assert changed.revision == (seen.revision or 0) + 1, "the answer was lost, the change was made once"
    assert [write.new for write in changed.written if write.index == "0x6081"] == [70_000]
    with pytest.raises(PreconditionFailed):
        await axis.configure({"velocity": None}, seen)
    assert (await axis.configure({"velocity": None})).settings["velocity"] == seen.settings["velocity"]


async def test_inputs_outputs_and_waits(bench: Bench) -> None:
    node = over(httpx.ASGITransport(bench.app)).node(1)
    bench.module.apply(lambda module, _: module.dictionary.store(IO_MODE, 0b0010))
    assert (await node.switch_output("OUT1", on=True)).on
    assert [output.usable for output in await node.outputs()] == [False, True, False, False]
    wait = await node.wait_for_input("IN3")
    bench.module.apply(lambda module, _: module.terminals.apply(3, True))
    assert (await wait.wait(timeout=5)).result is not None
    assert [level.on for level in (await node.inputs()).digital] == [False, True, False, True]
    late = await node.wait_for_analog(0, "raw", above=100, timeout_s=0.2)
    with pytest.raises(InputTimeout):
        await late.wait(timeout=5)
    with pytest.raises(UnknownTerminal):
        await node.switch_output(9, on=False)
