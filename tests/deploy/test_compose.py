"""docker-compose.yml starts both services from one Dockerfile: by content, and by Docker where it is."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from repository import ROOT

from app.configuration.configuration import Settings, load_settings

TOKEN = "0f1e2d3c4b5a69788796a5b4c3d2e1f0"


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]


def test_both_services_run_from_the_one_image_that_the_dockerfile_builds(services: dict[str, Any]) -> None:
    assert set(services) == {"simulator", "service"}
    assert services["simulator"]["build"] == "."
    assert {service["image"] for service in services.values()} == {"canaxis"}
    assert (ROOT / "Dockerfile").is_file()


def test_the_port_is_published_to_this_machine_only_and_a_token_is_required(services: dict[str, Any]) -> None:
    service = services["service"]
    assert service["ports"] == ["127.0.0.1:8402:8402"]
    assert service["environment"]["CANAXIS_SERVER__TOKEN"].startswith("${CANAXIS_TOKEN:?")
    assert "ports" not in services["simulator"]


def test_the_service_starts_after_the_simulator_listens(services: dict[str, Any]) -> None:
    assert services["service"]["depends_on"]["simulator"]["condition"] == "service_healthy"
    assert "29536" in " ".join(services["simulator"]["healthcheck"]["test"])


def test_the_environment_of_the_service_makes_settings_that_reach_the_simulator(
    services: dict[str, Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    environment = dict(services["service"]["environment"], CANAXIS_SERVER__TOKEN=TOKEN)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    settings: Settings = load_settings()
    assert settings.bus.arguments()["host"] == "simulator"
    assert settings.server.token is not None
    assert settings.server.token.get_secret_value() == TOKEN


def test_the_dockerfile_installs_the_locked_dependencies_and_drops_root() -> None:
    text = (ROOT / "Dockerfile").read_text()
    assert "--require-hashes -r requirements.lock" in text
    assert "USER canaxis" in text
    copied = {line.split()[1] for line in text.splitlines() if line.startswith("COPY")}
    for package in ("app", "canaxis", "canaxis_command", "drivers", "requirements.lock"):
        assert package in copied
        assert (ROOT / package).exists()


def test_docker_reads_the_compose_file_where_docker_is() -> None:
    probe = ["docker", "compose", "version"]
    if shutil.which("docker") is None or subprocess.run(probe, capture_output=True, check=False).returncode:
        return  # its content is held by the tests above; without Docker's own reader there is nothing to add
    result = subprocess.run(
        ["docker", "compose", "config", "--quiet"],
        cwd=ROOT,
        env={**os.environ, "CANAXIS_TOKEN": TOKEN},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
