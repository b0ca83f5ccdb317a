"""`pip install canaxis[server]` in an empty environment of each Python: demo and fixtures, in any company.

What a dependency or a file of data is missing for fails here, for nothing of ours is at hand but the wheel.
"""

from __future__ import annotations

import re
import signal
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest
from empty_environment import DEV_LOCK, EmptyEnvironment, build_wheel, interpreter

pytestmark = [pytest.mark.installed, pytest.mark.timeout(600)]

VERSIONS = [
    pytest.param(version, marks=pytest.mark.xdist_group(version)) for version in ("3.11", "3.12", "3.13")
]
SCRIPT = """\
import sys
from canaxis import Client

with Client(sys.argv[1]) as client:
    stage = client.node("stage")
    for name in "xy":
        stage.axis(name).enable()
    stage.axis("x").move(2000, "steps").wait(timeout=60)
    here = (2000, 0)
    points = [(0, here, (0, 0)), (1, (2500, 400), (0, 0))]
    path = client.trajectory([("stage", "x", "steps"), ("stage", "y", "steps")], points, cycle_ms=10)
    path.wait(timeout=60)
    print(*(stage.axis(name).status().position.steps for name in "xy"))
"""
"""A move, and a path: that takes the sender's process as well, and what reads a path from JSON."""
NOT_OURS = """\
WHOSE = "the user's"
"""
FIXTURE_TEST = """\
import app
import drivers


def test_a_move(canaxis_service, simulated_port):
    axis = canaxis_service.client.node("stage").axis("x")
    axis.enable()
    axis.move(100, "steps").wait(timeout=60)
    assert simulated_port.panel(1).state().axes[0].position == 100
    assert app.WHOSE == drivers.WHOSE == "the user's"
"""


@pytest.fixture(scope="module", params=VERSIONS)
def environment(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> EmptyEnvironment:
    python = interpreter(request.param)
    if python is None:
        pytest.skip(f"there is no Python {request.param} here")
    folder = tmp_path_factory.mktemp("server")
    environment = EmptyEnvironment(folder / "environment", python)
    environment.install_wheel(build_wheel(folder), "server")
    return environment


@pytest.fixture
def others(tmp_path: Path) -> Path:
    """A folder with packages `app` and `drivers` of its own."""
    for name in ("app", "drivers"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(NOT_OURS)
    return tmp_path


@contextmanager
def demo(
    environment: EmptyEnvironment,
    folder: Path,
    variables: Mapping[str, str] | None = None,
    command: tuple[str, ...] = ("canaxis",),
) -> Iterator[str]:
    """`canaxis demo` in a folder; gives the service's address."""
    process = subprocess.Popen(
        [environment.bin / command[0], *command[1:], "demo", "--port", "0", "--can-port", "0"],
        cwd=folder,
        env=environment.variables({"XDG_STATE_HOME": str(folder), **(variables or {})}),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    with process.stdout:
        try:
            said = ""
            for line in process.stdout:
                said += line
                if "Ctrl-C ends both" in line:
                    break
            found = re.search(r"API +(http://127\.0\.0\.1:\d+)/api/v1", said)
            assert found, said
            yield found[1]
            process.send_signal(signal.SIGINT)
            assert "service and simulator ended" in process.stdout.read()
            assert process.wait(60) == 0
        finally:
            process.kill()
            process.wait()


def test_the_demo_runs_in_an_empty_folder_and_moves_an_axis(
    environment: EmptyEnvironment, tmp_path: Path
) -> None:
    folder = tmp_path / "empty"
    folder.mkdir()
    with demo(environment, folder) as url:
        moved = environment.run("python", "-c", SCRIPT, url, cwd=folder)
    assert moved.stdout == "2500 400\n", moved.stderr
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("command", [("canaxis",), ("python", "-m", "canaxis")], ids=" ".join)
def test_other_packages_of_our_names_break_nothing(
    environment: EmptyEnvironment, others: Path, command: tuple[str, ...]
) -> None:
    variables = {"PYTHONPATH": "."}
    with demo(environment, others, variables, command) as url:
        script = f"import app, drivers\nprint(app.WHOSE, drivers.WHOSE)\n{SCRIPT}"
        moved = environment.run("python", "-c", script, url, cwd=others, variables=variables)
    assert moved.stdout == "the user's the user's\n2500 400\n", moved.stderr


def test_the_fixtures_work_beside_other_packages_of_our_names(
    environment: EmptyEnvironment, others: Path
) -> None:
    environment.install(("pytest", "iniconfig", "packaging", "pluggy", "pygments"), DEV_LOCK)
    (others / "conftest.py").write_text('pytest_plugins = ["canaxis.testing"]\n')
    (others / "test_move.py").write_text(FIXTURE_TEST)
    done = environment.run(
        *("python", "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider", "."),
        cwd=others,
        variables={"PYTHONPATH": "."},
    )
    assert "1 passed" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("arguments", [("eds", "print"), ("openapi",), ("--help",), ("settings", "--help")])
def test_commands_that_need_no_bus(
    environment: EmptyEnvironment, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    done = environment.run("canaxis", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
