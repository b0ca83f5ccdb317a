"""A service that is killed in mid-move, and the next one on the same file and the same bus."""

from __future__ import annotations

import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from canaxis_processes import JSON, Running, until_ready

AXIS = "/api/v1/nodes/1/axes/0"


def test_a_killed_service_loses_no_operation(tmp_path: Path) -> None:
    (tmp_path / "canaxis.yaml").write_text(
        "network: {consumer_ms: 10000, node_heartbeat_ms: 3000}\nstore: {file: canaxis.db}\n"
    )
    with Running(tmp_path, "simulate", "--port", "0") as simulator:
        port = int(simulator.until(r"listens on 127\.0\.0\.1:(\d+)")[1])
        serve = ("serve", "--option", f"port={port}", "--port", "0")
        with Running(tmp_path, *serve) as service:
            with httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1]) as http:
                until_ready(http)
                assert http.post(f"{AXIS}/enable", headers=JSON).status_code == 200
                short = {"target": 500, "unit": "steps"}
                done = http.post(f"{AXIS}/move?wait=20", json=short, timeout=30).json()
                assert done["state"] == "succeeded"
                long = {"target": 9_000_000, "unit": "steps"}
                running = http.post(f"{AXIS}/move", json=long).json()
            service.signal(signal.SIGKILL)
            service.ended()
        with (
            Running(tmp_path, *serve) as service,
            httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1]) as http,
        ):
            until_ready(http)
            told = http.get("/api/v1/operations").json()["operations"]
            assert [o["id"] for o in told] == [running["id"], done["id"]]
            assert told[0]["state"] == "failed"
            assert told[0]["error"]["code"] == "service_restarted"
            assert told[1] == done


def test_a_retry_after_a_kill_learns_what_became_and_moves_nothing(tmp_path: Path) -> None:
    (tmp_path / "canaxis.yaml").write_text(
        "network: {consumer_ms: 10000, node_heartbeat_ms: 3000}\nstore: {file: canaxis.db}\n"
    )
    key = JSON | {"Idempotency-Key": "plate-7"}
    body = {"target": 9_000_000, "relative": True, "unit": "steps"}
    with Running(tmp_path, "simulate", "--port", "0") as simulator:
        port = int(simulator.until(r"listens on 127\.0\.0\.1:(\d+)")[1])
        serve = ("serve", "--option", f"port={port}", "--port", "0")
        with (
            Running(tmp_path, *serve) as service,
            httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1]) as http,
            ThreadPoolExecutor(1) as another,
        ):
            until_ready(http)
            assert http.post(f"{AXIS}/enable", headers=JSON).status_code == 200
            cut_off = another.submit(http.post, f"{AXIS}/move?wait=600", json=body, headers=key, timeout=60)
            while not (found := http.get("/api/v1/operations?state=running").json()["operations"]):
                pass
            service.signal(signal.SIGKILL)
            service.ended()
            with pytest.raises(httpx.TransportError):
                cut_off.result(30)
        with (
            Running(tmp_path, *serve) as service,
            httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1]) as http,
        ):
            until_ready(http)
            replayed = http.post(f"{AXIS}/move?wait=600", json=body, headers=key)
            assert (replayed.status_code, replayed.headers["idempotent-replayed"]) == (200, "true")
            assert replayed.headers["location"] == f"/api/v1/operations/{found[0]['id']}"
            assert replayed.json()["error"]["code"] == "service_restarted"
            assert len(http.get("/api/v1/operations").json()["operations"]) == 1
