"""The Dockerfile without an engine: its instructions in a folder that stands for the container's root.

What takes a container stays untried: the base image itself, the user, the volume's mount. `pip` and Python
are those of an empty environment; what would change this machine (`useradd`, `install`) is written down.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path, PurePath

from dockerfile_parse import DockerfileParser
from empty_environment import EmptyEnvironment, interpreter
from repository import ROOT

PIP = """\
#!/bin/sh
# Ours, on the image's Python. Its cache and no compiling save us minutes, and mean nothing for what is tried.
for argument; do
    shift
    case $argument in
    --no-cache-dir) set -- "$@" --no-compile ;;
    *) set -- "$@" "$argument" ;;
    esac
done
exec {pip} -m pip --disable-pip-version-check --quiet --python {python} "$@"
"""
USERADD = """\
#!/bin/sh
for last; do :; done
echo "$last" >> {root}/users
"""
INSTALL = """\
#!/bin/sh
for last; do :; done
mkdir -p "{root}$last"
"""


class ReplayedImage:
    """What the Dockerfile makes, below `root`."""

    def __init__(self, root: Path) -> None:
        """Follow every instruction. Raises `AssertionError` at one that fails, or that isn't known here."""
        self.root = root
        self.users: list[str] = []
        self.volumes: list[str] = []
        self.entrypoint: list[str] = []
        self.command: list[str] = []
        self._place = PurePath("/")
        self._variables: dict[str, str] = {}
        self._environment: EmptyEnvironment
        for step in DockerfileParser(path=str(ROOT / "Dockerfile")).structure:
            if step["instruction"] != "COMMENT":
                follow = getattr(self, f"_{step['instruction'].lower()}", None)
                assert follow is not None, f"{step['instruction']} can't be replayed"
                follow(step["value"])

    def start(self, *arguments: str, variables: Mapping[str, str] | None = None) -> subprocess.Popen[str]:
        """`docker run` with these arguments in CMD's place, without any: CMD."""
        return subprocess.Popen(
            [*self._resolved(self.entrypoint), *(arguments or self.command)],
            cwd=self._here,
            env=self._seen(variables),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def execute(self, *command: str) -> int:
        """`docker exec`; the exit code."""
        return subprocess.run(
            self._resolved(command), cwd=self._here, env=self._seen(), check=False, timeout=60
        ).returncode

    def path(self, inside: str) -> Path:
        """Where a path of the image is here."""
        return self.root / inside.lstrip("/")

    @property
    def _here(self) -> Path:
        return self.path(str(self._place))

    def _seen(self, more: Mapping[str, str] | None = None) -> dict[str, str]:
        seen = self._environment.variables({**self._variables, **(more or {})})
        return seen | {"PATH": f"{self.root / 'shims'}{os.pathsep}{seen['PATH']}"}

    def _resolved(self, command: list[str] | tuple[str, ...]) -> list[str]:
        program = shutil.which(command[0], path=self._seen()["PATH"])
        assert program is not None, f"{command[0]} is not in the image"
        return [program, *command[1:]]

    def _from(self, value: str) -> None:
        found = re.match(r"python:(\d+\.\d+)\b", value)
        assert found, value
        python = interpreter(found[1]) or Path(sys.executable)
        self._environment = EmptyEnvironment(self.root / "environment", python)
        shims = self.root / "shims"
        shims.mkdir()
        for name, text in (("pip", PIP), ("useradd", USERADD), ("install", INSTALL)):
            text = text.format(root=self.root, pip=sys.executable, python=self._environment.python)
            (shims / name).write_text(text)
            (shims / name).chmod(0o755)

    def _workdir(self, value: str) -> None:
        self._place /= value
        self._here.mkdir(parents=True, exist_ok=True)

    def _copy(self, value: str) -> None:
        *sources, target = value.split()
        for source in sources:
            assert not _ignored(source), f"{source} is in .dockerignore"
            if (ROOT / source).is_dir():
                shutil.copytree(
                    ROOT / source,
                    self._here / target,
                    ignore=lambda folder, names: [
                        name for name in names if _ignored(os.path.relpath(Path(folder, name), ROOT))
                    ],
                )
            else:
                shutil.copy(ROOT / source, self._here / target)

    def _run(self, value: str) -> None:
        done = subprocess.run(
            ["sh", "-c", value], cwd=self._here, env=self._seen(), capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{value}: {done.stderr}"

    def _env(self, value: str) -> None:
        for pair in shlex.split(value):
            name, _, content = pair.partition("=")
            self._variables[name] = str(self.path(content)) if content.startswith("/") else content

    def _volume(self, value: str) -> None:
        self.volumes.append(value)

    def _user(self, value: str) -> None:
        self.users.append(value)

    def _entrypoint(self, value: str) -> None:
        self.entrypoint = json.loads(value)

    def _cmd(self, value: str) -> None:
        self.command = json.loads(value)


def _ignored(path: str) -> bool:
    patterns = (ROOT / ".dockerignore").read_text().split()
    return any(PurePath(path).match(pattern.removeprefix("**/")) for pattern in patterns)
