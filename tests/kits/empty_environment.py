"""Virtual environments with nothing in them but what a user's installation brings, from the lock files."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import requires
from pathlib import Path
from zipfile import ZipFile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from repository import ROOT

LOCK = ROOT / "requirements.lock"
DEV_LOCK = ROOT / "requirements-dev.lock"
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
"""Ours, for environments that have none of their own: with `--python` it works on another interpreter."""


def interpreter(version: str) -> Path | None:
    """A Python of this version, e.g. "3.12": our own, in PATH, or pyenv's; None if there is none."""
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        return Path(sys.executable)
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    named = [Path(found)] if (found := shutil.which(f"python{version}")) else []
    for candidate in (*named, *sorted(pyenv.glob(f"versions/{version}.*/bin/python"))):
        look = [candidate, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
        if subprocess.run(look, capture_output=True, text=True, check=False).stdout.strip() == version:
            return candidate  # pyenv's shims are in PATH also where they lead nowhere
    return None


def build_wheel(folder: Path, source: Path = ROOT) -> Path:
    """The wheel of what is in `source`."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder]
    subprocess.run(build, cwd=source, check=True, capture_output=True)
    (wheel,) = folder.glob("canaxis-*.whl")
    return wheel


def metadata(wheel: Path) -> str:
    """What it says of itself."""
    with ZipFile(wheel) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        return archive.read(name).decode()


def closure(wheel: Path, *extras: str) -> set[str]:
    """The names of all that the wheel needs, by its own metadata and that of what is installed here."""
    declared = re.findall(r"^Requires-Dist: (.*)$", metadata(wheel), re.MULTILINE)
    found: set[tuple[str, str]] = set()
    _follow(declared, extras, found)
    return {name for name, _ in found}


def _follow(declared: Iterable[str], extras: Iterable[str], found: set[tuple[str, str]]) -> None:
    for requirement in map(Requirement, declared):
        wanted = [extra for extra in ("", *extras) if _applies(requirement, extra)]
        if not wanted:
            continue
        name = canonicalize_name(requirement.name)
        new = {(name, extra) for extra in ("", *requirement.extras)} - found
        if new:
            found |= new
            _follow(requires(name) or (), requirement.extras, found)


def _applies(requirement: Requirement, extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


class EmptyEnvironment:
    """A virtual environment in `folder`; not even pip is in it."""

    def __init__(self, folder: Path, python: Path) -> None:
        self.folder = folder
        self.bin = folder / "bin"
        self.python = self.bin / "python"
        subprocess.run([python, "-m", "venv", "--without-pip", folder], check=True)

    def install(self, names: Iterable[str], lock: Path = LOCK) -> None:
        """What the lock file has of these names, with its hashes, and nothing that isn't named."""
        rows = re.split(r"\n(?=\S)", lock.read_text())
        wanted = {canonicalize_name(name) for name in names}
        locked = {canonicalize_name(re.split(r"[=\[]", row, maxsplit=1)[0]): row for row in rows}
        chosen = self.folder / "chosen.lock"
        chosen.write_text("\n".join(locked[name] for name in wanted if name in locked) + "\n")
        self._pip("--require-hashes", "-r", str(chosen))

    def install_wheel(self, wheel: Path, *extras: str) -> None:
        """A wheel of ours with all that its metadata asks for, at the versions of the lock file."""
        self.install(closure(wheel, *extras))
        self._pip(str(wheel))

    def run(
        self, *command: str, cwd: Path, variables: Mapping[str, str] | None = None, within: float = 120
    ) -> subprocess.CompletedProcess[str]:
        """Run one of its commands to its end."""
        return subprocess.run(
            [self.bin / command[0], *command[1:]],
            cwd=cwd,
            env=self.variables(variables),
            capture_output=True,
            text=True,
            check=False,
            timeout=within,
            stdin=subprocess.DEVNULL,
        )

    def variables(self, more: Mapping[str, str] | None = None) -> dict[str, str]:
        """Our own variables but for what would find anything outside, or set the service."""
        foreign = ("CANAXIS_", "PYTHON", "PYTEST_", "VIRTUAL_ENV", "COV_")
        own = {name: value for name, value in os.environ.items() if not name.startswith(foreign)}
        return own | {"PATH": f"{self.bin}{os.pathsep}{own['PATH']}", **(more or {})}

    def names(self) -> set[str]:
        """The distributions in it."""
        infos = self.folder.glob("lib/python*/site-packages/*.dist-info")
        return {canonicalize_name(info.name.split("-")[0]) for info in infos}

    def _pip(self, *arguments: str) -> None:
        install = ["--python", self.python, "install", "--no-deps", "--no-compile", *arguments]
        done = subprocess.run([*PIP, *install], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
