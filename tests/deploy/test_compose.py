"""docker-compose.yml starts both services from one Dockerfile: by content, and by Docker where it is."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tomllib
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
import yaml
from dockerfile_parse import DockerfileParser
from repository import ROOT
from typer.testing import CliRunner

from app.cli import command_line
from app.configuration.configuration import Configuration
from app.configuration.loading import load_configuration

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
    configuration: Configuration = load_configuration()
    assert configuration.bus.arguments()["host"] == "simulator"
    assert configuration.server.token is not None
    assert configuration.server.token.get_secret_value() == TOKEN


def test_the_dockerfile_installs_the_locked_dependencies_and_drops_root() -> None:
    steps = dockerfile()
    assert any("--require-hashes -r requirements.lock" in value for value in steps["RUN"])
    assert steps["USER"] == ["canaxis"]
    copied = {source for value in steps["COPY"] for source in value.split()[:-1]}
    for package in ("app", "canaxis", "canaxis_command", "drivers", "requirements.lock"):
        assert package in copied
        assert (ROOT / package).exists()


def test_what_the_image_and_the_compose_file_start_are_commands_of_ours(services: dict[str, Any]) -> None:
    steps = dockerfile()
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    ((program,), command) = json.loads(steps["ENTRYPOINT"][-1]), json.loads(steps["CMD"][-1])
    assert program in scripts
    for arguments in (command, *(service["command"] for service in services.values())):
        # `--help` is heeded once the rest is understood: an option that the command doesn't have is refused.
        done = CliRunner().invoke(command_line([arguments[0]]), [*arguments, "--help"])
        assert done.exit_code == 0, done.output


def dockerfile() -> dict[str, list[str]]:
    """The values of each kind of instruction, in their order."""
    found: dict[str, list[str]] = defaultdict(list)
    for step in DockerfileParser(path=str(ROOT / "Dockerfile")).structure:
        found[step["instruction"]].append(step["value"])
    return found


def test_docker_reads_the_compose_file_where_docker_is() -> None:
    probe = ["docker", "compose", "version"]
    if shutil.which("docker") is None or subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("there is no `docker compose` here (test_installed_image.py plays both services without)")
    result = subprocess.run(
        ["docker", "compose", "config", "--quiet"],
        cwd=ROOT,
        env={**os.environ, "CANAXIS_TOKEN": TOKEN},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
