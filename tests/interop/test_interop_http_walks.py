"""The three walks of manual §6.2, §7.2 and §8.3 over HTTP, against `canaxis simulate` in its own process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from canaxis_processes import simulator_and_service

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    directory: Path = tmp_path_factory.mktemp("walks")
    with simulator_and_service(directory) as (_, _, client):
        yield client


def command(http: httpx.Client, axis: str, name: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
    """A command that must succeed; waits for its end."""
    path = f"/api/v1/nodes/1/axes/{axis}/{name}"
    if body is None:
        response = http.post(path, headers={"Content-Type": "application/json"})
    else:
        response = http.post(f"{path}?wait=40", json=body)
    assert response.status_code == 200, response.text
    reply: dict[str, Any] = response.json()
    return reply


def status(http: httpx.Client, axis: str) -> dict[str, Any]:
    reply: dict[str, Any] = http.get(f"/api/v1/nodes/1/axes/{axis}").json()
    return reply


def test_profile_position_to_500000(http: httpx.Client) -> None:
    assert command(http, "x", "enable")["state"] == "operation_enabled"
    body = {
        "target": 500000,
        "unit": "steps",
        "velocity": 250000,
        "acceleration": 500000,
        "deceleration": 500000,
    }
    operation = command(http, "x", "move", body)
    assert operation["state"] == "succeeded", operation["error"]
    assert operation["result"]["position"]["steps"] == 500000
    after = status(http, "x")
    assert after["position"]["steps"] == 500000
    assert (after["mode"], after["target_reached"], after["moving"]) == ("profile_position", True, False)
    assert status(http, "y")["position"]["steps"] == 0, "the other axes stay where they are"
    assert command(http, "x", "disable")["state"] == "switch_on_disabled"


def test_profile_velocity_at_100000_then_0(http: httpx.Client) -> None:
    command(http, "y", "enable")
    running = command(http, "y", "velocity", {"velocity": 100000, "unit": "steps", "acceleration": 200000})
    assert running["state"] == "succeeded", running
    turning = status(http, "y")
    assert (turning["mode"], turning["moving"]) == ("profile_velocity", True)
    assert turning["velocity"]["steps"] == pytest.approx(100000, rel=0.02)
    stopped = command(http, "y", "velocity", {"velocity": 0, "unit": "steps"})
    assert stopped["state"] == "succeeded", stopped
    after = status(http, "y")
    assert after["velocity"]["steps"] == 0
    assert (after["state"], after["moving"]) == ("operation_enabled", False)
    command(http, "y", "disable")


def test_homing_19_at_50000_and_10000(http: httpx.Client) -> None:
    command(http, "z", "enable")
    assert status(http, "z")["referenced"] is False
    body = {"method": 19, "fast": 50000, "slow": 10000, "acceleration": 200000, "unit": "steps"}
    operation = command(http, "z", "home", body)
    assert operation["state"] == "succeeded", operation["error"]
    after = status(http, "z")
    assert after["referenced"] is True
    assert after["moving"] is False
    moved = command(http, "z", "move", {"target": 1000, "unit": "steps"})
    assert moved["result"]["position"]["steps"] == 1000, "positions count from the home that was found"
    command(http, "z", "disable")
