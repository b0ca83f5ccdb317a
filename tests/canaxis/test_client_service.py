"""The client on a real service in a process of its own; every block of docs/python-client.md runs here."""

from __future__ import annotations

import asyncio
import itertools
import re
from collections.abc import Iterator
from contextlib import aclosing, closing

import pytest
from canaxis_processes import simulator_and_service
from repository import ROOT

from canaxis import (
    AsyncClient,
    BadValue,
    Client,
    NotReady,
    OperationCancelled,
    Sample,
    StopLatched,
    UnknownNode,
)

pytestmark = [pytest.mark.process, pytest.mark.timeout(180)]

ADDRESS = "http://127.0.0.1:8402"
SETTINGS = """\
network: {consumer_ms: 10000, node_heartbeat_ms: 3000}
nodes:
  - id: 1
    name: stage
    axes:
      - {name: x, unit: mm, steps_per_unit: 12800}
      - {name: y}
      - {name: z}
"""
BLOCKS = [
    pytest.param(block, id=f"{page}-{number}")
    for page in ("docs/python-client.md", "docs/motion.md", "docs/trajectories.md", "README.md")
    for number, block in enumerate(
        block
        for block in re.findall(r"```python\n(.*?)```", (ROOT / page).read_text("utf-8"), re.DOTALL)
        if "canaxis import" in block
    )
]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where a service with a simulated module is."""
    directory = tmp_path_factory.mktemp("client")
    (directory / "canaxis.yaml").write_text(SETTINGS)
    with simulator_and_service(directory) as (_, _, http):
        yield str(http.base_url)


@pytest.fixture
def client(url: str) -> Iterator[Client]:
    """A client whose axes end disabled."""
    with Client(url) as client:
        yield client
        client.stop_all()
        for axis in "xyz":
            client.node("stage").axis(axis).disable()
        client.reset_stop()


@pytest.mark.parametrize("block", BLOCKS)
def test_each_block_of_the_pages_runs(block: str, url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ADDRESS in block
    exec(compile(block.replace(ADDRESS, url), "a block", "exec"), {"__name__": "__main__"})
    with Client(url) as client:
        client.node("stage").axis("x").disable()


def test_an_axis_from_enabling_to_its_evidence(client: Client) -> None:
    axis = client.node("stage").axis("x")
    assert axis.enable().state == "operation_enabled"
    move = axis.move(1.5, "mm", relative=True, velocity=10).wait(timeout=60)
    assert (move.state, move.done, move.progress) == ("succeeded", True, 1.0)
    (track,) = move.evidence.axes
    assert track.start is not None
    assert track.end is not None
    assert track.end.steps - track.start.steps == 19200
    assert axis.status().position == track.end
    assert client.operation(move.id).status == move.status
    assert [operation.id for operation in client.operations(limit=1)] == [move.id]
    home = axis.home(method=35).wait(timeout=60)
    assert home.kind == "home"
    assert axis.status().referenced


def test_positions_have_names_and_inputs_are_waited_for(client: Client) -> None:
    axis = client.node("stage").axis("z")
    axis.set_position(700, "steps").wait(timeout=60)
    assert axis.teach("park").position.steps == 700
    axis.enable()
    axis.move(900, "steps").wait(timeout=60)
    assert axis.go("park").wait(timeout=60).evidence.axes[0].end == axis.status().position
    assert [position.name for position in axis.positions()] == ["park"]
    assert axis.forget_position("park").position.steps == 700
    node = client.node("stage")
    assert node.wait_for_input("IN0", becomes=False).wait(timeout=60).kind == "wait_input"
    assert [level.name for level in node.inputs().analog] == ["AIN0", "AIN1"]
    assert not any(output.usable for output in node.outputs())
    with pytest.raises(NotReady):
        node.switch_output(0, on=True)


def test_a_speed_is_reached_and_a_stop_ends_it(client: Client) -> None:
    axis = client.node(1).axis(1)
    axis.enable()
    axis.velocity(20000, "steps").wait(timeout=60)
    assert axis.status().moving
    axis.stop()
    assert not axis.status().moving


def test_a_stop_for_everything_is_latched_and_ends_the_motion(client: Client) -> None:
    axis = client.node("stage").axis("y")
    axis.enable()
    move = axis.move(50_000_000, "steps")
    assert client.stop_all("Enough.").complete
    with pytest.raises(OperationCancelled, match="Enough"):
        move.wait(timeout=60)
    assert client.stop_state().reason == "Enough."
    with pytest.raises(StopLatched) as refused:
        axis.move(1, "steps")
    assert "reset" in refused.value.hint
    assert not client.reset_stop().latched


def test_looking_before_moving_and_a_queue(client: Client) -> None:
    axis = client.node("stage").axis("y")
    seen = axis.predict_move(30_000, "steps", relative=True)
    assert (seen.accepted, seen.begins, [one.code for one in seen.obstacles]) == (
        False,
        None,
        ["not_enabled"],
    )
    while obstacles := axis.readiness().move:
        assert obstacles[0].action is not None
        client.follow(obstacles[0].action)
    assert axis.predict_velocity(1000, "steps", duration_s=1).accepted
    assert axis.predict_home(method=35).predicted_s == 0
    first = axis.move(30_000, "steps", relative=True)
    assert first.status.predicted_s == seen.predicted_s
    second = axis.move(-30_000, "steps", relative=True, on_busy="queue")
    assert axis.status().queued == (second.id,)
    assert second.wait(timeout=60).state == first.refresh().state == "succeeded"
    turning = axis.velocity(9000, "steps", travel=4000, on_busy="replace").wait(timeout=60)
    assert turning.result is not None
    assert not turning.result["turning"]


def test_what_can_be_looked_at(client: Client) -> None:
    node = client.node("stage")
    (status,) = client.nodes()
    assert status.state == "operational"
    assert [axis.name for axis in status.axes] == [axis.name for axis in node.axes()] == ["x", "y", "z"]
    assert node.status().identity == status.identity
    assert node.read_object(0x1018, 1).value == 0x0286
    assert isinstance(node.emergencies(), tuple)
    assert client.ready().ready
    assert client.bus().state == "active"
    readiness = node.axis("z").readiness()
    assert not readiness.ready
    assert readiness.move[0].code == "not_enabled"


def test_refusals_come_as_classes_with_hints(client: Client) -> None:
    with pytest.raises(NotReady) as not_ready:
        client.node("stage").axis("z").move(5, "steps")
    assert not_ready.value.status == 409
    assert [obstacle.code for obstacle in not_ready.value.obstacles] == ["not_enabled"]
    assert not_ready.value.obstacles[0].remedy == not_ready.value.hint
    with pytest.raises(BadValue, match="furlong"):
        client.node("stage").axis("x").move(5, "furlong")
    with pytest.raises(BadValue, match=r"target.*number"):
        client.node("stage").axis("x").move("far", "mm")  # pyright: ignore[reportArgumentType] - as a script may have it
    with pytest.raises(UnknownNode):
        client.node("nowhere?").status()


def test_the_stream_draws_a_move_of_the_chosen_axis(client: Client) -> None:
    axis = client.node("stage").axis("y")
    axis.enable()
    start = axis.status().position
    assert start is not None
    goal = start.steps + 30000
    with closing(axis.stream()) as samples:
        first = next(samples)
        assert (first.node, first.axis, first.name, first.unit) == (1, 1, "y", "steps")
        assert (first.position, first.state, first.gap) == (start.value, "operation_enabled", False)
        axis.move(goal, "steps")
        seen = [first]
        while seen[-1].moving or seen[-1].position != goal:
            seen.append(next(samples))
    assert {sample.name for sample in seen} == {"y"}
    assert any(sample.velocity > 0 for sample in seen)
    assert all(one.time <= two.time for one, two in itertools.pairwise(seen))


def test_the_stream_in_an_event_loop(url: str) -> None:
    async def first_samples() -> list[Sample]:
        async with AsyncClient(url) as client, aclosing(client.stream()) as samples:
            return [await anext(samples) for _ in range(3)]

    assert {sample.name for sample in asyncio.run(first_samples())} == {"x", "y", "z"}
