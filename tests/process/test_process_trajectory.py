"""A trajectory whose set points come from a process of its own, over socketcand."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import httpx
import pytest
from canaxis_processes import JSON, Canaxis, simulator_and_service

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]

WAVE = [
    {"t": number / 10, "positions": [place], "velocities": [0 if number in (0, 20) else speed]}
    for number, place, speed in [
        (n, 15_000 * (3 * (n / 20) ** 2 - 2 * (n / 20) ** 3), 15_000 * (6 * (n / 20) - 6 * (n / 20) ** 2) / 2)
        for n in range(21)
    ]
]
BODY = {"axes": [{"node": 1, "axis": 0, "unit": "steps"}], "cycle_ms": 10, "points": WAVE}


def child_of(service: Canaxis) -> int:
    """The sender's process."""
    deadline = time.monotonic() + 20
    path = Path(f"/proc/{service.process.pid}/task")
    while time.monotonic() < deadline:
        for task in path.iterdir():
            children = (task / "children").read_text().split()
            if children:
                return int(children[0])
        time.sleep(0.01)
    raise AssertionError("the service has no child")


def enable(http: httpx.Client) -> None:
    assert http.post("/api/v1/nodes/1/axes/0/enable", headers=JSON).status_code == 200


def test_a_sender_process_plays_a_path_and_one_that_dies_leaves_a_stopped_axis(tmp_path: Path) -> None:
    with simulator_and_service(tmp_path) as (_, service, http):
        enable(http)
        played = http.post("/api/v1/trajectories?wait=40", json=BODY).json()
        assert played["state"] == "succeeded", (played["reason"], played["result"])
        assert played["result"]["sender"] == "process"
        assert played["result"]["cycles"] == 201
        assert played["evidence"]["axes"][0]["end"]["steps"] == 15_000
        back = {**BODY, "points": [{**p, "t": 2 - p["t"]} for p in reversed(WAVE)]}
        for point in back["points"]:
            point["velocities"] = [-v for v in point["velocities"]]
        second = http.post("/api/v1/trajectories", json=back).json()
        pid = child_of(service)
        while http.get(f"/api/v1/operations/{second['id']}").json()["state"] == "queued":
            time.sleep(0.01)
        time.sleep(0.3)
        os.kill(pid, signal.SIGKILL)
        ended = http.get(f"/api/v1/operations/{second['id']}?wait=20").json()
        assert ended["state"] == "failed", ended
        assert "sender" in ended["reason"]
        stopped = http.post("/api/v1/nodes/1/axes/0/stop", headers=JSON).json()
        assert (stopped["moving"], stopped["state"]) == (False, "operation_enabled")
