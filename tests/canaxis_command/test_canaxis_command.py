"""The command's first step: whose packages it takes, and what it says where the service is not installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import canaxis

WITHOUT = """\
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name == {missing!r}:
            raise ModuleNotFoundError("No module named " + name, name=name)

sys.meta_path.insert(0, Missing())
sys.argv[1:] = {arguments!r}
import canaxis_command
canaxis_command.main()
"""


def python(folder: Path, *arguments: str, path: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.process
@pytest.mark.parametrize("module", ["canaxis", "canaxis_command"])
def test_other_packages_of_our_names_are_passed_over(tmp_path: Path, module: str) -> None:
    for name in ("app", "drivers"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('not yours')")
    done = python(tmp_path, "-m", module, "eds", "print", path=".")
    assert (done.returncode, done.stderr) == (0, "")
    assert "TMCM-3216" in done.stdout


def test_the_search_path_stays_as_it_was(tmp_path: Path) -> None:
    code = "import canaxis_command as c, sys; before = [*sys.path]; c.claim(); print(before == sys.path)"
    assert python(tmp_path, "-c", code).stdout == "True\n"


@pytest.mark.parametrize("missing", ["typer", "fastapi"])
def test_what_is_missing_is_told_in_a_line(tmp_path: Path, missing: str) -> None:
    done = python(tmp_path, "-c", WITHOUT.format(missing=missing, arguments=["serve", "--port", "0"]))
    assert (done.returncode, done.stdout) == (2, "")
    told = f"canaxis: the service is not installed (there is no {missing}); pip install 'canaxis[server]'\n"
    assert done.stderr == told


def test_a_module_of_ours_that_is_missing_is_a_fault_of_ours(tmp_path: Path) -> None:
    done = python(tmp_path, "-c", WITHOUT.format(missing="app.commands.serve", arguments=["serve"]))
    assert done.returncode == 1
    assert "ModuleNotFoundError" in done.stderr


def test_the_version_needs_no_service(tmp_path: Path) -> None:
    done = python(tmp_path, "-c", WITHOUT.format(missing="app", arguments=["--version"]))
    assert (done.returncode, done.stdout) == (0, f"canaxis {canaxis.__version__}\n"), done.stderr
