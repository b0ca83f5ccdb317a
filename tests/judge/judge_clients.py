"""Clients that command at random: with leases, cancellations, retries under equal keys, and restarts between.

Each is a thread with a Python client of its own. What it was answered is kept, for the judge.
"""

from __future__ import annotations

import contextlib
import random
import threading
import time
import uuid
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import httpx

from canaxis import CanaxisError, Client, Operation, Patience

PATIENCE = Patience(total=60)
"""Longer than a restart takes."""
FAST = {"velocity": 1_000_000, "acceleration": 10_000_000, "deceleration": 10_000_000}
"""Steps/s and steps/s2: so that ten thousand moves end today."""
RECOVERABLE = ("not_ready", "axis_fault", "stop_latched", "node_away", "bus_down")
SHORT = 60.0
"""Seconds that a request may take."""
JSON = {"Content-Type": "application/json"}


@dataclass
class Command:
    """One command that takes time, and what became of it as far as the client knows."""

    client: int
    kind: str
    node: int
    axis: int
    arguments: dict[str, Any]
    key: str = field(default_factory=lambda: uuid.uuid4().hex)
    lease: str | None = None
    answers: list[Answer] = field(default_factory=list["Answer"])
    """One for each time that it was sent and answered."""
    unknown: bool = False
    """Whether it was once given up without an answer."""

    @property
    def operations(self) -> set[str]:
        """The ids that it was answered with; more than one would be one too many."""
        return {answer.operation for answer in self.answers if answer.operation is not None}


@dataclass(frozen=True)
class Answer:
    """What came back, and between which instants of the monotonic clock it was decided."""

    asked: float
    came: float
    operation: str | None = None
    refused: str | None = None
    """The code of the problem."""
    replayed: bool = False
    """Whether it is the answer to an earlier request with the same key."""


@dataclass(frozen=True)
class Lease:
    """A lease that this client held, from its answer to its own end of it."""

    client: int
    node: int
    axis: int
    begun: float
    ended: float


class Targets:
    """Each target is given once, so that the bus tells which command a set point belongs to."""

    def __init__(self, seed: int, most: int) -> None:
        self._targets = random.Random(seed).sample(range(-most, most), 2 * most)
        self._lock = threading.Lock()

    def next(self) -> int:
        """Another one, in steps."""
        with self._lock:
            return self._targets.pop()


class Budget:
    """How many commands are still to be given, by all together."""

    def __init__(self, commands: int) -> None:
        self._left = commands
        self._lock = threading.Lock()
        self.given = 0
        """How many were taken so far."""

    def take(self) -> bool:
        """Whether there is one more."""
        with self._lock:
            if self._left <= 0:
                return False
            self._left -= 1
            self.given += 1
            return True


class RandomClient(threading.Thread):
    """Commands axes until the budget is spent."""

    def __init__(
        self,
        number: int,
        seed: int,
        url: str,
        axes: Sequence[tuple[int, int]],
        targets: Targets,
        budget: Budget,
    ) -> None:
        super().__init__(name=f"client {number}")
        self.number = number
        self.commands: list[Command] = []
        self.leases: list[Lease] = []
        self.failure: BaseException | None = None
        self._chance = random.Random(f"{seed} {number}")
        self._axes = axes
        self._targets = targets
        self._budget = budget
        self._url = url
        self._operations: list[Operation] = []
        self._lease: tuple[str, str, tuple[int, int], float, float] | None = None
        """Id, token, axis, since when, until when."""

    def run(self) -> None:
        """Until there is nothing left to command; `failure` holds what should not have happened."""
        try:
            with (
                Client(self._url, timeout=SHORT, patience=PATIENCE) as self._client,
                httpx.Client(base_url=self._url, timeout=SHORT) as self._http,
            ):
                while self._budget.take():
                    self._act()
                self._give_back()
        except BaseException as error:
            self.failure = error

    def _act(self) -> None:
        action = self._chance.choices(
            (self._move, self._turn, self._zero, self._stop_one, self._cancel, self._again, self._take_lease),
            (66, 7, 3, 6, 6, 8, 4),
        )[0]
        action()

    # --- commands that take time ---

    def _move(self) -> None:
        arguments = {
            "target": self._targets.next(),
            "unit": "steps",
            "on_busy": self._chance.choice(("reject", "reject", "replace", "queue", "queue")),
            **FAST,
        }
        self._command("move", arguments)

    def _turn(self) -> None:
        velocity = self._chance.choice((-1, 1)) * self._chance.randrange(1_000, 200_000)
        arguments = {
            "velocity": velocity,
            "unit": "steps",
            "duration_s": round(self._chance.uniform(0.02, 0.2), 3),
            "acceleration": FAST["acceleration"],
        }
        self._command("velocity", arguments)

    def _zero(self) -> None:
        self._command("home", {"method": 35})

    def _command(self, kind: str, arguments: dict[str, Any]) -> None:
        lease = self._held()
        node, axis = lease[2] if lease and self._chance.random() < 0.7 else self._chance.choice(self._axes)
        token = lease[1] if lease and lease[2] == (node, axis) else None
        command = Command(self.number, kind, node, axis, arguments, lease=token)
        self.commands.append(command)
        answer = self._send(command)
        if answer is not None and answer.refused in RECOVERABLE:
            self._recover(command)
        elif self._chance.random() < 0.35 and self._operations:
            with contextlib.suppress(CanaxisError):
                self._operations[-1].wait(timeout=self._chance.uniform(0, 0.5))

    def _send(self, command: Command) -> Answer | None:
        """Give it, or give it again: the key is the same."""
        path = f"/api/v1/nodes/{command.node}/axes/{command.axis}/{command.kind}"
        headers = JSON | {"Idempotency-Key": command.key}
        if command.lease is not None:
            headers["Lease"] = command.lease
        asked = time.monotonic()
        try:
            reply = self._until_answered(path, command.arguments, headers)
        except httpx.HTTPError:
            command.unknown = True
            return None
        body = reply.json()
        replayed = "idempotent-replayed" in reply.headers
        if reply.is_success:
            answer = Answer(asked, time.monotonic(), operation=body["id"], replayed=replayed)
            with contextlib.suppress(CanaxisError):
                self._operations.append(self._client.operation(body["id"]))
                del self._operations[:-20]
        else:
            answer = Answer(asked, time.monotonic(), refused=body["code"], replayed=replayed)
        command.answers.append(answer)
        return answer

    def _until_answered(self, path: str, body: dict[str, Any], headers: dict[str, str]) -> httpx.Response:
        """The same request until there is an answer, over a restart too."""
        deadline = time.monotonic() + PATIENCE.total
        while True:
            try:
                reply = self._http.post(path, json=body, headers=headers)
            except httpx.TransportError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.05)
                continue
            if reply.status_code == 409 and reply.json()["code"] == "key_in_flight":
                time.sleep(0.02)
                continue
            return reply

    def _again(self) -> None:
        """An older command under its key, as a client does that lost the answer."""
        if self.commands:
            self._send(self._chance.choice(self.commands[-50:]))

    # --- the rest ---

    def _stop_one(self) -> None:
        node, axis = self._chance.choice(self._axes)
        with contextlib.suppress(CanaxisError):
            self._client.node(node).axis(axis).stop()

    def _cancel(self) -> None:
        if self._operations:
            with contextlib.suppress(CanaxisError):
                self._chance.choice(self._operations).cancel()

    def _recover(self, command: Command) -> None:
        """As a person would: wait for the node, stop, acknowledge, enable; a lease may be in the way."""
        self._wait_for_nodes()
        axis = self._client.node(command.node).axis(command.axis)
        headers = JSON if command.lease is None else JSON | {"Lease": command.lease}
        with contextlib.suppress(CanaxisError):
            axis.stop()
        path = f"/api/v1/nodes/{command.node}/axes/{command.axis}"
        for verb in ("reset-fault", "enable"):
            with contextlib.suppress(httpx.TransportError):
                self._http.post(f"{path}/{verb}", headers=headers)

    def _wait_for_nodes(self) -> None:
        for _ in range(200):
            with contextlib.suppress(httpx.TransportError):
                if self._http.get("/readyz").status_code == 200:
                    return
            time.sleep(0.1)

    # --- leases ---

    def _held(self) -> tuple[str, str, tuple[int, int], float, float] | None:
        if self._lease is not None and time.monotonic() > self._lease[4]:
            self._note_end(self._lease[4])
        return self._lease

    def _take_lease(self) -> None:
        if self._held() is not None:
            self._give_back()
            return
        node, axis = self._chance.choice(self._axes)
        ttl = self._chance.choice((1, 2, 5))
        body = {"axes": [{"node": node, "axis": axis}], "ttl_s": ttl, "owner": self.name}
        asked = time.monotonic()
        with contextlib.suppress(httpx.TransportError):
            reply = self._http.post("/api/v1/leases", json=body, headers=JSON)
            if reply.is_success:
                lease = reply.json()
                self._lease = (lease["id"], lease["token"], (node, axis), time.monotonic(), asked + ttl)

    def _give_back(self) -> None:
        if self._lease is None:
            return
        lease = self._lease
        self._note_end(min(time.monotonic(), lease[4]))
        with contextlib.suppress(httpx.TransportError):
            self._http.post(f"/api/v1/leases/{lease[0]}/release", headers=JSON | {"Lease": lease[1]})

    def _note_end(self, ended: float) -> None:
        assert self._lease is not None
        self.leases.append(Lease(self.number, *self._lease[2], self._lease[3], ended))
        self._lease = None
