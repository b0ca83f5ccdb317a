"""Random commands by several clients over restarts of the service, and what must be true afterwards.

Simulator, service and bus are real; the service is killed (SIGKILL) in between. What was asked is known
from the clients, what was done from the bus, what is remembered from the store.
"""

from __future__ import annotations

import signal
import socket
import sqlite3
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from canaxis_processes import Canaxis, Running, until_ready
from judge_clients import Budget, Command, Lease, RandomClient, Targets
from judge_wire import SetPoint, WireLog

from app.operations.schemas import OperationReply, OperationState

NODES = (1, 2)
AXES = tuple((node, axis) for node in NODES for axis in range(3))
FARTHEST = 60_000
"""Steps: the targets are within this of 0."""
RAMP = 10.0
"""Seconds within which every axis stands once all has ended."""
ENDED = {OperationState.SUCCEEDED, OperationState.FAILED, OperationState.CANCELLED}
SETTINGS = """\
network: {consumer_ms: 2000, node_heartbeat_ms: 1000}
store: {file: canaxis.db}
server: {requests_per_second: null}
nodes:
  - {id: 1, name: stage, axes: [{name: x}, {name: y}, {name: z}]}
  - {id: 2, name: tower, axes: [{name: u}, {name: v}, {name: w}]}
"""


@dataclass
class Verdict:
    """What was found."""

    commands: int
    seconds: float
    counts: Counter[str] = field(default_factory=Counter[str])
    """Operations by kind and state, refusals by code."""
    complaints: list[str] = field(default_factory=list[str])
    """What should not be; empty if all is well."""


def run(directory: Path, commands: int, *, clients: int = 4, restarts: int = 3, seed: int = 0) -> Verdict:
    """Give so many commands, killing the service `restarts` times meanwhile, then judge."""
    (directory / "canaxis.yaml").write_text(SETTINGS)
    port = _free_port()
    budget, targets = Budget(commands), Targets(seed, FARTHEST)
    url = f"http://127.0.0.1:{port}"
    kills: list[float] = []
    began = time.monotonic()
    with ExitStack() as stack:
        nodes = ",".join(map(str, NODES))
        simulator = stack.enter_context(Running(directory, "simulate", "--port", "0", "--nodes", nodes))
        can_port = int(simulator.until(r"listens on 127\.0\.0\.1:(\d+)")[1])
        wire = stack.enter_context(WireLog(can_port, NODES))
        serve = ("serve", "--option", f"port={can_port}", "--port", str(port))
        service = _start(stack, directory, serve, url)
        _enable_all(url)
        crowd = [RandomClient(n, seed, url, AXES, targets, budget) for n in range(clients)]
        for client in crowd:
            client.start()
        for restart in range(1, restarts + 1):
            while budget.given < commands * restart // (restarts + 1) and any(c.is_alive() for c in crowd):
                time.sleep(0.01)
            service.signal(signal.SIGKILL)
            service.ended()
            kills.append(time.monotonic())
            service = _start(stack, directory, serve, url)
        for client in crowd:
            client.join()
        with httpx.Client(base_url=url, timeout=60) as http:
            _until_all_ended(http)
            statuses = _at_rest(http)
        service.signal(signal.SIGTERM)
        service.ended()
        handed_over = Counter(wire.handed_over)
    verdict = Verdict(sum(len(client.commands) for client in crowd), time.monotonic() - began)
    verdict.complaints += [f"{c.name} broke off: {c.failure!r}" for c in crowd if c.failure is not None]
    verdict.complaints += [f"axis {s['name']} still moves" for s in statuses if s["moving"]]
    given = [command for client in crowd for command in client.commands]
    leases = [_cut(lease, kills) for client in crowd for lease in client.leases]
    _judge(verdict, given, _operations(directory / "canaxis.db"), handed_over)
    _judge_leases(verdict, given, leases)
    return verdict


# --- judging ---


def _judge(
    verdict: Verdict,
    commands: Sequence[Command],
    stored: dict[str, tuple[OperationReply, str | None]],
    handed_over: Counter[SetPoint],
) -> None:
    """Each command exactly once, each end right, nothing lost."""
    complain = verdict.complaints.append
    by_key = Counter(key for _, key in stored.values() if key is not None)
    known: set[str] = set()
    for command in commands:
        told = command.operations
        known |= told
        what = f"{command.kind} {command.key} of client {command.client}"
        verdict.counts.update(f"refused: {a.refused}" for a in command.answers if a.refused is not None)
        if len(told) > 1:
            complain(f"{what} became {len(told)} operations: {told}")
        if by_key[command.key] > 1:
            complain(f"{what} is {by_key[command.key]} times in the store")
        if told and told != {o for o, (_, key) in stored.items() if key == command.key}:
            complain(f"{what}: operation {told} is lost")
        if command.kind == "move":
            edges = handed_over[SetPoint(command.node, command.axis, command.arguments["target"])]
            found = [reply for reply, key in stored.values() if key == command.key]
            _judge_move(verdict, what, edges, found[0] if found else None)
    for reply, _ in stored.values():
        verdict.counts[f"{reply.kind}: {reply.state.value}"] += 1
        if reply.state not in ENDED or reply.ended is None:
            complain(f"operation {reply.id} ended never: {reply.state.value}")
        if (reply.state is OperationState.FAILED) != (reply.error is not None):
            complain(f"operation {reply.id} is {reply.state.value} with the error {reply.error}")


def _judge_move(verdict: Verdict, what: str, edges: int, operation: OperationReply | None) -> None:
    succeeded = operation is not None and operation.state is OperationState.SUCCEEDED
    if edges > 1 or (succeeded and edges != 1) or (operation is None and edges):
        state = "no operation" if operation is None else operation.state.value
        verdict.complaints.append(f"{what} was handed over {edges} times: {state}")
    if operation is not None and succeeded:
        (track,) = operation.evidence.axes
        ends = (operation.request["target_steps"], track.end.steps if track.end else None)
        if ends[0] != ends[1]:
            verdict.complaints.append(f"{what} succeeded at {ends[1]} instead of {ends[0]}")


def _judge_leases(verdict: Verdict, commands: Sequence[Command], leases: Sequence[Lease]) -> None:
    """While somebody held an axis, nobody else's command was taken there."""
    verdict.counts["leases"] = len(leases)
    for command in commands:
        for answer in command.answers:
            for lease in leases:
                if (
                    answer.operation is not None
                    and not answer.replayed
                    and (lease.node, lease.axis) == (command.node, command.axis)
                    and lease.client != command.client
                    and lease.begun < answer.asked
                    and answer.came < lease.ended
                ):
                    verdict.complaints.append(
                        f"{command.kind} {command.key} of client {command.client} was taken though "
                        f"client {lease.client} held axis {lease.axis} of node {lease.node}"
                    )


def _cut(lease: Lease, kills: Sequence[float]) -> Lease:
    """A lease ends with the service that gave it."""
    ended = min((kill for kill in kills if lease.begun < kill), default=lease.ended)
    return Lease(lease.client, lease.node, lease.axis, lease.begun, min(ended, lease.ended))


# --- the processes ---


def _start(stack: ExitStack, directory: Path, serve: Sequence[str], url: str) -> Canaxis:
    service = stack.enter_context(Running(directory, *serve))
    service.until(r"http://127\.0\.0\.1:\d+/api/v1")
    with httpx.Client(base_url=url, timeout=60) as http:
        until_ready(http)
    return service


def _enable_all(url: str) -> None:
    with httpx.Client(base_url=url, timeout=60, headers={"Content-Type": "application/json"}) as http:
        for node, axis in AXES:
            reply = http.post(f"/api/v1/nodes/{node}/axes/{axis}/enable")
            assert reply.status_code == 200, reply.text


def _until_all_ended(http: httpx.Client) -> None:
    for state in ("running", "queued"):
        for operation in http.get(f"/api/v1/operations?state={state}&limit=1000").json()["operations"]:
            http.get(f"/api/v1/operations/{operation['id']}?wait=30")


def _at_rest(http: httpx.Client) -> list[dict[str, Any]]:
    """Every axis's status, once none moves: a cancelled operation's axis may still be ramping down."""
    deadline = time.monotonic() + RAMP
    while True:
        statuses = [http.get(f"/api/v1/nodes/{node}/axes/{axis}").json() for node, axis in AXES]
        if not any(status["moving"] for status in statuses) or time.monotonic() > deadline:
            return statuses


def _operations(file: Path) -> dict[str, tuple[OperationReply, str | None]]:
    with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as store:
        rows: list[Any] = store.execute("SELECT id, document, key FROM operations").fetchall()
    store.close()
    return {
        id_: (OperationReply.model_validate_json(document), key and key.rpartition(":")[2])
        for id_, document, key in rows
    }


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
