"""The image and both services of docker-compose.yml, played without an engine in a folder of their own."""

from __future__ import annotations

import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
import yaml
from replayed_image import ReplayedImage
from repository import ROOT

import canaxis

pytestmark = [pytest.mark.installed, pytest.mark.timeout(600), pytest.mark.xdist_group("image")]

TOKEN = "0f1e2d3c4b5a69788796a5b4c3d2e1f0"
SERVICES: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
PORTS = {"simulator": "29536", "service": "8402"}
"""Of the compose file; here each takes a free one."""


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> ReplayedImage:
    return ReplayedImage(tmp_path_factory.mktemp("image"))


@contextmanager
def running(process: subprocess.Popen[str], says: str) -> Iterator[re.Match[str]]:
    """Wait for what it says; at the end stop it as `docker stop` does."""
    assert process.stdout is not None
    with process.stdout:
        try:
            said = ""
            for line in process.stdout:
                said += line
                if found := re.search(says, line):
                    break
            else:
                pytest.fail(f"ended with {process.wait()}: {said}")
            yield found
            process.send_signal(signal.SIGTERM)
            rest = process.stdout.read()
            assert process.wait(60) == 0, rest
        finally:
            process.kill()
            process.wait()


def test_its_entrypoint_is_the_command(image: ReplayedImage) -> None:
    process = image.start("--version")
    assert process.communicate(timeout=60)[0] == f"canaxis {canaxis.__version__}\n"


def test_by_itself_it_serves_and_remembers_in_its_volume(image: ReplayedImage) -> None:
    settings = {"CANAXIS_SERVER__PORT": "0", "CANAXIS_BUS__OPTIONS": '{"port": 9}'}
    with running(image.start(variables=settings), r"listens on (http://\S+)/api/v1") as found:
        assert httpx.get(f"{found[1]}/livez").status_code == 200
    (volume,) = image.volumes
    assert image.path(volume).joinpath("canaxis.db").is_file()


def test_it_drops_root_for_a_user_that_it_makes(image: ReplayedImage) -> None:
    assert image.users == image.path("users").read_text().split() == ["canaxis"]


def healthy(image: ReplayedImage, name: str, port: str) -> None:
    """Run the health check as often as compose would."""
    check = SERVICES[name]["healthcheck"]
    kind, *command = (part.replace(PORTS[name], port) for part in check["test"])
    assert kind == "CMD"
    for _ in range(check["retries"]):
        if image.execute(*command) == 0:
            return
        time.sleep(0.1)
    pytest.fail(f"{name} did not become healthy")


def arguments(name: str) -> list[str]:
    command = SERVICES[name]["command"]
    assert command[command.index("--port") + 1] == PORTS[name]
    return [part.replace(PORTS[name], "0") for part in command]


def test_both_services_of_the_compose_file_find_each_other(image: ReplayedImage) -> None:
    with running(image.start(*arguments("simulator")), r"listens on 0\.0\.0\.0:(\d+)") as simulator:
        healthy(image, "simulator", simulator[1])
        variables = {name: str(value) for name, value in SERVICES["service"]["environment"].items()}
        variables["CANAXIS_SERVER__TOKEN"] = TOKEN
        options = variables["CANAXIS_BUS__OPTIONS"]
        options = options.replace('"simulator"', '"127.0.0.1"').replace(PORTS["simulator"], simulator[1])
        variables["CANAXIS_BUS__OPTIONS"] = options
        process = image.start(*arguments("service"), variables=variables)
        with running(process, r"listens on http://127\.0\.0\.1:(\d+)/api/v1") as service:
            healthy(image, "service", service[1])
            url = f"http://127.0.0.1:{service[1]}"
            assert httpx.get(f"{url}/api/v1/nodes").status_code == 401
            with canaxis.Client(url, token=TOKEN) as client:
                ready_within(client, 30)
                axis = client.node("stage").axis("x")
                axis.enable()
                axis.move(1000, "steps").wait(timeout=60)


def ready_within(client: canaxis.Client, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while client.node("stage").status().state != "operational":
        assert time.monotonic() < deadline
        time.sleep(0.05)
