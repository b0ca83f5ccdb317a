"""The script of docs/lab-scheduler.md on a real service: to its end, and into a fault."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from canaxis_processes import Running, until_ready
from repository import ROOT

pytestmark = [pytest.mark.process, pytest.mark.timeout(240)]

ADDRESS = "http://127.0.0.1:8402"
PAGE = ROOT / "docs" / "lab-scheduler.md"
(SCRIPT,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
AXIS = "unit: mm, steps_per_unit: 500, velocity: 600, acceleration: 20000, deceleration: 20000"
SETTINGS = f"""\
network: {{consumer_ms: 10000, node_heartbeat_ms: 3000}}
nodes:
  - id: 1
    name: stage
    axes:
      - {{name: x, {AXIS}}}
      - {{name: y, {AXIS}}}
      - {{name: z, {AXIS}, homing_method: 19, homing_fast: 50, homing_slow: 10, homing_acceleration: 2000}}
"""


@pytest.fixture
def urls(tmp_path: Path) -> Iterator[tuple[str, str]]:
    """Where a service is, and where the fault panel of its simulated module is."""
    (tmp_path / "canaxis.yaml").write_text(SETTINGS)
    with Running(tmp_path, "simulate", "--port", "0", "--panel-port", "0") as simulator:
        port = simulator.until(r"listens on 127\.0\.0\.1:(\d+)")[1]
        panel = simulator.until(r"fault panel on (http://127\.0\.0\.1:\d+)/panel")[1]
        with Running(tmp_path, "serve", "--option", f"port={port}", "--port", "0") as service:
            url = service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1]
            with httpx.Client(base_url=url) as http:
                until_ready(http)
            yield url, panel


def start(url: str) -> subprocess.Popen[str]:
    """The script, with the address of this service."""
    assert ADDRESS in SCRIPT
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT.replace(ADDRESS, url)], stdout=subprocess.PIPE, text=True
    )


def test_it_is_thirty_lines_long() -> None:
    assert len([line for line in SCRIPT.splitlines() if line.strip()]) <= 30


@pytest.mark.slow
def test_it_visits_every_well(urls: tuple[str, str]) -> None:
    url, _ = urls
    with start(url) as script:
        told, _ = script.communicate(timeout=200)
    assert script.returncode == 0, told
    wells = [f"well {row}{column}" for row in "ABCDEFGH" for column in range(1, 13)]
    assert told.splitlines() == wells
    operations = httpx.get(f"{url}/api/v1/operations?limit=1000").json()["operations"]
    kinds = [operation["kind"] for operation in operations]
    assert (kinds.count("coordinated_move"), kinds.count("move"), kinds.count("home")) == (96, 192, 3)
    assert {operation["state"] for operation in operations} == {"succeeded"}
    assert httpx.get(f"{url}/api/v1/leases").json()["leases"] == []


def test_on_a_fault_it_stops_everything_and_reports(urls: tuple[str, str]) -> None:
    url, panel = urls
    with start(url) as script:
        assert script.stdout is not None
        assert script.stdout.readline() == "well A1\n"
        fault = httpx.post(f"{panel}/panel/v1/nodes/1/set_temperature", json={"axis": 1, "celsius": 150})
        assert fault.is_success, fault.text
        told = script.stdout.read()
        assert script.wait(60) == 1, told
    assert "Motor driver too hot" in told
    state = httpx.get(f"{url}/api/v1/stop").json()
    assert state["latched"]
    assert state["reason"].startswith("Plate 7 was given up")
    axes = httpx.get(f"{url}/api/v1/nodes/1/axes").json()["axes"]
    assert not any(axis["moving"] for axis in axes)
