"""The dead man's switch between processes: our heartbeat ends however we end, and the module stops its motor.

All times are the simulator's own (its fault panel tells them), so that nothing here depends on when we look.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from canaxis_processes import JSON, Canaxis, Running, until_ready

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]

BLOCKABLE = Path(__file__).with_name("blockable_canaxis.py")
CONSUMER = 1.0
"""Seconds of 1016h in these tests: long enough that a busy machine isn't taken for a dead one."""
SETTINGS = """\
network: {consumer_ms: 1000, node_heartbeat_ms: 1000}
nodes:
  - {id: 1, name: stage, axes: [{name: x, quick_stop_deceleration: 100000}]}
"""
SPEED, QUICK_STOP = 50_000, 100_000
RAMP = SPEED / QUICK_STOP
"""Seconds that the fault reaction takes from full speed, with 6085h."""
DETECTION = 0.05
"""Seconds beyond 1016h within which the module must have noticed."""
BUSY = 0.5
"""What a machine that is short of time may add to that: its timers and ours are late together."""
FAR = {"target": 2_000_000_000, "unit": "steps", "velocity": SPEED, "acceleration": 400_000}
AXIS = "/api/v1/nodes/1/axes/0"


@dataclass
class Module:
    """The simulated module, as its fault panel shows it; reached past every bus and every master."""

    http: httpx.Client
    can_port: int

    def now(self) -> dict[str, Any]:
        return self.http.get("/panel/v1/nodes/1").json()

    def until(self, condition: Callable[[dict[str, Any]], object], within: float = 30.0) -> dict[str, Any]:
        """The first snapshot for which something holds."""
        deadline = time.monotonic() + within
        while not condition(seen := self.now()):
            assert time.monotonic() < deadline, seen
            time.sleep(0.01)
        return seen


@pytest.fixture
def module(tmp_path: Path) -> Iterator[Module]:
    (tmp_path / "canaxis.yaml").write_text(SETTINGS)
    with Running(tmp_path, "simulate", "--port", "0", "--panel-port", "0") as simulator:
        panel = simulator.until(r"fault panel on (http://127\.0\.0\.1:\d+)")[1]
        can_port = int(simulator.until(r"listens on 127\.0\.0\.1:(\d+)")[1])
        with httpx.Client(base_url=panel, timeout=60) as http:
            yield Module(http, can_port)


@contextmanager
def service_on(directory: Path, module: Module) -> Iterator[tuple[Canaxis, httpx.Client]]:
    """A service on the module's bus; ready or not."""
    with (
        Running(directory, "serve", "--option", f"port={module.can_port}", "--port", "0") as service,
        httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1], timeout=60) as http,
    ):
        yield service, http


def set_moving(http: httpx.Client, module: Module) -> None:
    """Have axis 0 on its way to a far target, at full speed."""
    until_ready(http)
    assert http.post(f"{AXIS}/enable", headers=JSON).status_code == 200
    assert http.post(f"{AXIS}/move", json=FAR).status_code == 202
    module.until(lambda seen: seen["axes"][0]["velocity"] == SPEED)


def assert_stopped_by_itself(module: Module) -> None:
    """It noticed within 1016h and 50 ms, and stood one ramp later; at every look in between it obeyed."""
    lost = module.until(lambda seen: seen["watch"]["lost_at"] is not None)
    watch = lost["watch"]
    assert CONSUMER <= watch["lost_at"] - watch["heard_at"] <= CONSUMER + DETECTION + BUSY
    stopped = lost
    while stopped["axes"][0]["moving"]:
        assert stopped["clock"] <= watch["lost_at"] + RAMP + BUSY, stopped
        stopped = module.now()
    assert stopped["nmt_state"] == "stopped"
    assert stopped["axes"][0]["state"] == "fault"
    assert stopped["error_register"] & 0x10, "communication error"
    rest = stopped["axes"][0]["place"]
    assert module.until(lambda seen: seen["clock"] > stopped["clock"] + 0.5)["axes"][0]["place"] == rest


def assert_reported_by_the_service_itself(http: httpx.Client) -> None:
    """Once it runs again it takes the module in, and says what became of the motion."""
    until_ready(http)
    [operation] = http.get("/api/v1/operations").json()["operations"]
    assert operation["state"] == "failed"
    assert operation["error"]["hint"]
    status = http.get(AXIS).json()
    assert (status["state"], status["moving"]) == ("fault", False)
    assert "0x8130" in [
        each["code"] for each in http.get("/api/v1/nodes/1/emergencies").json()["emergencies"]
    ]
    metrics = dict(line.rsplit(" ", 1) for line in http.get("/metrics").text.splitlines())
    assert float(metrics["canaxis_bus_late_heartbeats_total"]) > 0


def test_a_killed_service_s_motor_stops_and_the_next_service_reports_it(
    module: Module, tmp_path: Path
) -> None:
    with service_on(tmp_path, module) as (service, http):
        set_moving(http, module)
        service.signal(signal.SIGKILL)
        service.ended()
    assert_stopped_by_itself(module)
    with service_on(tmp_path, module) as (_, http):
        until_ready(http)
        found = http.get(AXIS).json()
        assert (found["state"], found["moving"], found["referenced"]) == ("fault", False, False)
        assert module.now()["axes"][0]["state"] == "fault", "nothing is reset by itself"
        refused = http.post(f"{AXIS}/enable", headers=JSON)
        assert (refused.status_code, refused.json()["code"]) in ((409, "not_ready"), (409, "axis_fault"))
        assert http.post(f"{AXIS}/reset-fault", headers=JSON).status_code == 200
        assert http.post(f"{AXIS}/enable", headers=JSON).status_code == 200
        move = http.post(f"{AXIS}/move?wait=30", json={"target": 100, "unit": "steps", "relative": True})
        assert move.json()["state"] == "succeeded", move.text


def test_a_stopped_process_s_motor_stops(module: Module, tmp_path: Path) -> None:
    with service_on(tmp_path, module) as (service, http):
        set_moving(http, module)
        service.signal(signal.SIGSTOP)
        try:
            assert_stopped_by_itself(module)
        finally:
            service.signal(signal.SIGCONT)
        assert_reported_by_the_service_itself(http)


def test_a_blocked_event_loop_s_motor_stops(module: Module, tmp_path: Path) -> None:
    block = ("--option", f"port={module.can_port}", "--port", "0")
    with (
        Running(tmp_path, "8", "serve", *block, program=[str(BLOCKABLE)]) as service,
        httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1], timeout=60) as http,
    ):
        set_moving(http, module)
        service.signal(signal.SIGUSR1)
        assert_stopped_by_itself(module)
        assert service.process.poll() is None, "it lives, it only doesn't get to do anything"
        assert_reported_by_the_service_itself(http)


def test_a_service_killed_and_started_at_once_adopts_what_turns(module: Module, tmp_path: Path) -> None:
    (tmp_path / "canaxis.yaml").write_text("network: {consumer_ms: 10000, node_heartbeat_ms: 1000}\n")
    with service_on(tmp_path, module) as (service, http):
        set_moving(http, module)
        service.signal(signal.SIGKILL)
        service.ended()
    with service_on(tmp_path, module) as (_, http):
        until_ready(http)
        seen = module.now()
        assert seen["watch"]["lost_at"] is None, "it came within 1016h"
        assert seen["axes"][0]["velocity"] == SPEED, "nothing was reset"
        found = http.get(AXIS).json()
        assert (found["state"], found["moving"]) == ("operation_enabled", True)
        assert found["velocity"]["steps"] == SPEED
        refused = http.post(f"{AXIS}/move", json=FAR)
        assert (refused.status_code, refused.json()["code"]) == (409, "not_ready")
        assert [each["code"] for each in refused.json()["obstacles"]] == ["turning", "adopted"]
        assert http.post(f"{AXIS}/stop", headers=JSON).json()["moving"] is False
        assert module.now()["axes"][0]["moving"] is False
        assert http.post(f"{AXIS}/enable", headers=JSON).status_code == 200
        move = http.post(f"{AXIS}/move?wait=30", json={"target": 100, "unit": "steps", "relative": True})
        assert move.json()["state"] == "succeeded", move.text


HOLDER = """\
import sys, time
from canaxis import Client

with Client(sys.argv[1]) as client, client.node("stage").axis("x").jog() as jog:
    jog.hold(50_000, "steps", acceleration=100_000)
    time.sleep(100)
"""
SILENCE = 0.5
"""Seconds for which a hold counts."""


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_the_axis_stops_that_a_client_held_when_it_was_stopped(
    module: Module, tmp_path: Path, number: signal.Signals
) -> None:
    with service_on(tmp_path, module) as (_, http):
        until_ready(http)
        assert http.post(f"{AXIS}/enable", headers=JSON).status_code == 200
        holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(http.base_url)])
        try:
            module.until(lambda seen: seen["axes"][0]["velocity"] == SPEED)
            told = module.now()["clock"]
            holder.send_signal(number)
            stood = module.until(lambda seen: not seen["axes"][0]["moving"])
            assert stood["clock"] - told <= SILENCE + SPEED / 100_000 + BUSY
        finally:
            holder.kill()
            holder.wait()
        assert stood["axes"][0]["state"] == "operation_enabled", "the service stopped it, no fault"
        [operation] = http.get("/api/v1/operations").json()["operations"]
        ended = http.get(f"/api/v1/operations/{operation['id']}?wait=5").json()
        assert ended["state"] == "cancelled"
        assert ended["result"]["end"] == ("silence" if number is signal.SIGSTOP else "closed")
        assert ended["result"]["round_trip_p50_ms"] > 0


LONG_PATH = {
    "axes": [{"node": 1, "axis": 0, "unit": "steps"}],
    "cycle_ms": 20,
    "points": [
        {"t": 0, "positions": [0], "velocities": [0]},
        {"t": 2, "positions": [SPEED], "velocities": [SPEED]},
        {"t": 60, "positions": [59 * SPEED], "velocities": [SPEED]},
        {"t": 62, "positions": [60 * SPEED], "velocities": [0]},
    ],
}
AHEAD = 1.5
"""Seconds of set points that the sender has at hand, and the ramp with which it comes to rest, at most."""


@pytest.mark.parametrize("what", ["killed", "stopped", "killed with its sender"])
def test_axes_on_a_trajectory_stop_when_the_service_ends(module: Module, tmp_path: Path, what: str) -> None:
    with service_on(tmp_path, module) as (service, http):
        until_ready(http)
        assert http.post(f"{AXIS}/enable", headers=JSON).status_code == 200
        answer = http.post("/api/v1/trajectories", json=LONG_PATH)
        assert answer.status_code == 202, answer.text
        module.until(lambda seen: seen["axes"][0]["velocity"] >= 0.95 * SPEED)
        [sender] = children_of(service)
        told = module.now()["clock"]
        if what.endswith("sender"):
            os.kill(sender, signal.SIGKILL)
        service.signal(signal.SIGSTOP if what == "stopped" else signal.SIGKILL)
        stood = module.until(lambda seen: not seen["axes"][0]["moving"])
        assert stood["clock"] - told <= max(AHEAD, CONSUMER + RAMP) + BUSY
        lost = module.until(lambda seen: seen["watch"]["lost_at"] is not None)
        assert lost["watch"]["lost_at"] - lost["watch"]["heard_at"] <= CONSUMER + DETECTION + BUSY
        rest = module.until(lambda seen: seen["axes"][0]["state"] == "fault")["axes"][0]["place"]
        later = module.until(lambda seen: seen["clock"] > stood["clock"] + AHEAD)
        assert later["axes"][0]["place"] == rest, "no set point of the sender's moves it any more"
        if what == "stopped":
            service.signal(signal.SIGCONT)
            until_ready(http)
            [operation] = http.get("/api/v1/operations").json()["operations"]
            assert (operation["kind"], operation["state"]) == ("trajectory", "failed")
        gone = time.monotonic() + 10
        while Path(f"/proc/{sender}/stat").exists() and not is_zombie(sender):
            assert time.monotonic() < gone, "the sender outlives its service"
            time.sleep(0.01)


def children_of(service: Canaxis) -> list[int]:
    tasks = Path(f"/proc/{service.process.pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def is_zombie(process: int) -> bool:
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
