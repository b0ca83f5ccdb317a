"""`pip install canaxis` in an empty environment: the client, its types; the command says what is missing."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from empty_environment import DEV_LOCK, EmptyEnvironment, build_wheel

import canaxis

pytestmark = [pytest.mark.installed, pytest.mark.timeout(300), pytest.mark.xdist_group("client")]

RIGHT = """\
from canaxis import Client, Operation

with Client("http://127.0.0.1:8402") as client:
    move: Operation = client.node("stage").axis("x").move(12.5, "mm")
    moving: bool = client.node("stage").axis("x").status().moving
"""
WRONG = """\
from canaxis import Client

with Client("http://127.0.0.1:8402") as client:
    client.node("stage").axis("x").move("far", "mm")
    moving: str = client.node("stage").axis("x").status().moving
"""
FIXTURE_TEST = """\
pytest_plugins = ["canaxis.testing"]

def test_a_port(simulated_port):
    pass
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> EmptyEnvironment:
    folder = tmp_path_factory.mktemp("client")
    environment = EmptyEnvironment(folder / "environment", Path(sys.executable))
    environment.install_wheel(build_wheel(folder))
    return environment


def test_it_brings_httpx_and_what_that_needs(environment: EmptyEnvironment, tmp_path: Path) -> None:
    of_httpx = {"anyio", "certifi", "h11", "httpcore", "idna", "typing-extensions"}
    assert environment.names() - of_httpx == {"canaxis", "httpx"}
    code = "from canaxis import Client, __version__; print(__version__, Client('http://127.0.0.1:1'))"
    done = environment.run("python", "-W", "error", "-c", code, cwd=tmp_path)
    assert done.stdout.startswith(f"{canaxis.__version__} <canaxis.blocking.client.Client"), done.stderr


@pytest.mark.parametrize("command", [("canaxis",), ("python", "-m", "canaxis")], ids=" ".join)
def test_the_command_tells_its_version_and_what_is_missing(
    environment: EmptyEnvironment, tmp_path: Path, command: tuple[str, ...]
) -> None:
    assert environment.run(*command, "--version", cwd=tmp_path).stdout == f"canaxis {canaxis.__version__}\n"
    for arguments in ((), ("--help",), ("serve", "--port", "0")):
        done = environment.run(*command, *arguments, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        (line,) = done.stderr.splitlines()
        assert line.startswith("canaxis: ")
        assert "pip install 'canaxis[server]'" in line


def test_pyright_sees_the_types(environment: EmptyEnvironment, tmp_path: Path) -> None:
    (tmp_path / "pyrightconfig.json").write_text('{"typeCheckingMode": "strict"}')
    found = {name: by_pyright(environment, tmp_path, name, text) for name, text in scripts()}
    assert found == {"right.py": [], "wrong.py": ["reportArgumentType", "reportAssignmentType"]}


def by_pyright(environment: EmptyEnvironment, folder: Path, name: str, text: str) -> list[str]:
    (folder / name).write_text(text)
    done = subprocess.run(
        [sys.executable, "-m", "pyright", "--pythonpath", environment.python, "--outputjson", name],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return [row.get("rule", row["message"]) for row in json.loads(done.stdout)["generalDiagnostics"]]


def test_mypy_sees_the_types(environment: EmptyEnvironment, tmp_path: Path) -> None:
    found = {name: by_mypy(environment, tmp_path, name, text) for name, text in scripts()}
    assert found == {"right.py": [], "wrong.py": ["arg-type", "assignment"]}


def by_mypy(environment: EmptyEnvironment, folder: Path, name: str, text: str) -> list[str]:
    (folder / name).write_text(text)
    done = subprocess.run(
        [
            *(
                sys.executable,
                "-m",
                "mypy",
                "--strict",
                "--no-error-summary",
                "--cache-dir",
                folder / "cache",
            ),
            *("--python-executable", environment.python, name),
        ],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return [line.rpartition("[")[2].rstrip("]") for line in (done.stdout + done.stderr).splitlines()]


def scripts() -> tuple[tuple[str, str], ...]:
    return ("right.py", RIGHT), ("wrong.py", WRONG)


def test_the_fixtures_say_what_is_missing(environment: EmptyEnvironment, tmp_path: Path) -> None:
    environment.install(("pytest", "iniconfig", "packaging", "pluggy", "pygments"), DEV_LOCK)
    (tmp_path / "test_port.py").write_text(FIXTURE_TEST)
    done = environment.run("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", ".", cwd=tmp_path)
    assert done.returncode == 1
    assert "canaxis simulate ended: canaxis: the service is not installed" in done.stdout
    assert "pip install 'canaxis[server]'" in done.stdout
    assert "Traceback" not in done.stdout
