"""A bus that goes and comes back under a running service, as processes: no restart is needed."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import httpx
import pytest
from canaxis_processes import JSON, Running, until_ready

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]


def until_not_ready(http: httpx.Client, within: float = 30.0) -> list[str]:
    """Wait until the service says that it can't command; why."""
    deadline = time.monotonic() + within
    while (ready := http.get("/readyz")).status_code == 200:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return ready.json()["reasons"]


def test_a_socketcand_server_that_restarts_is_joined_again_by_the_same_service(tmp_path: Path) -> None:
    (tmp_path / "canaxis.yaml").write_text("network: {consumer_ms: 10000, node_heartbeat_ms: 3000}\n")
    with Running(tmp_path, "simulate", "--port", "0") as first:
        port = first.until(r"listens on 127\.0\.0\.1:(\d+)")[1]
        with (
            Running(tmp_path, "serve", "--option", f"port={port}", "--port", "0") as service,
            httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1], timeout=60) as http,
        ):
            until_ready(http)
            assert http.post("/api/v1/nodes/1/axes/0/enable", headers=JSON).status_code == 200
            move = http.post("/api/v1/nodes/1/axes/0/move", json={"target": 900_000, "unit": "steps"}).json()
            first.signal(signal.SIGKILL)
            first.ended()
            reasons = until_not_ready(http)
            assert reasons[0].startswith("The bus is")
            ended = http.get(f"{move['links']['self']}?wait=10").json()
            assert (ended["state"], ended["error"]["status"]) == ("failed", 503)
            refused = http.post("/api/v1/nodes/1/axes/0/enable", headers=JSON)
            assert (refused.status_code, refused.json()["code"]) == (503, "bus_down")
            with Running(tmp_path, "simulate", "--port", port):
                until_ready(http)
                assert http.get("/api/v1/nodes/1/axes/0").json()["state"] == "switch_on_disabled"
                assert http.post("/api/v1/nodes/1/axes/0/enable", headers=JSON).status_code == 200
                again = http.post(
                    "/api/v1/nodes/1/axes/0/move?wait=30", json={"target": 1000, "unit": "steps"}
                )
                assert again.json()["state"] == "succeeded", again.text
                assert "state=down" in service.text, "the journal tells of it"
