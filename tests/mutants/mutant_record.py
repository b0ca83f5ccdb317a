"""Which test reaches which statement, and how long it takes: recorded once, kept outside git.

Recorded anew are the tests of a file that changed, or that reached a file that changed; all of them if a
helper did.
"""

from __future__ import annotations

import builtins
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from mutant_hook import LINES, NOTE, PROBED, environment

LEAN = ("-p", "no:cacheprovider", "-p", "no:schemathesis")
"""What every pytest here is told."""
HELPERS = "helpers"
"""What tests share: a change there may change what any of them reaches."""


@dataclass
class Case:
    """One test."""

    seconds: float
    passed: bool
    reached: dict[str, int]
    """For each file the lines whose statements it reached, as the bits of a number."""


@dataclass
class TestFile:
    """What is known of one file's tests, and of what files as they were then."""

    __test__ = False

    digests: dict[str, str]
    cases: dict[str, Case]


@dataclass
class Record:
    """Of all the tests that take part."""

    files: dict[str, TestFile] = field(default_factory=dict)
    imported: dict[str, int] = field(default_factory=dict)
    """For each file the lines that are reached by importing it."""

    def cases(self) -> dict[str, Case]:
        """Every test that passes, by its id."""
        return {
            name: case for file in self.files.values() for name, case in file.cases.items() if case.passed
        }

    def failed(self) -> list[str]:
        """Those that did not pass though nothing was planted."""
        return [name for file in self.files.values() for name, case in file.cases.items() if not case.passed]

    @classmethod
    def load(cls, file: Path) -> Record:
        """What was kept; nothing if it can't be read."""
        try:
            kept = json.loads(file.read_bytes())
            return cls(
                {
                    name: TestFile(of["digests"], {test: Case(*case) for test, case in of["cases"].items()})
                    for name, of in kept["files"].items()
                },
                kept["imported"],
            )
        except (OSError, ValueError, KeyError, TypeError):
            return cls()

    def save(self, file: Path) -> None:
        """Keep it."""
        file.parent.mkdir(exist_ok=True)
        files = {
            name: {
                "digests": of.digests,
                "cases": {test: (case.seconds, case.passed, case.reached) for test, case in of.cases.items()},
            }
            for name, of in self.files.items()
        }
        file.write_text(json.dumps({"files": files, "imported": self.imported}))


@dataclass
class Recording:
    """What is recorded, and how."""

    root: Path
    watched: Sequence[str]
    """The files whose statements count."""
    tests: Sequence[str]
    marked: Mapping[str, str]
    """For each test file that is not run as a whole, the marks of those of its tests that are."""
    jobs: int

    def stale(self, record: Record) -> list[str]:
        """The test files of which nothing is known, or not any more; what was known is forgotten."""
        digests = self._digests()
        record.files = {
            name: of
            for name, of in record.files.items()
            if name in self.tests and all(digests.get(path) == digest for path, digest in of.digests.items())
        }
        return [name for name in self.tests if name not in record.files]

    def add(self, record: Record, tests: Sequence[str], seconds: float) -> bool:
        """Run test files and note what they reach; False if they don't end in time, and nothing is noted."""
        digests = self._digests()
        for mark in sorted({self.marked.get(name, "") for name in tests}):
            some = [name for name in tests if self.marked.get(name, "") == mark]
            with tempfile.TemporaryDirectory() as into:
                if not self._run(Path(into), some, mark, seconds):
                    return False
                found = _gathered(Path(into), self.watched, record.imported)
            for name in some:
                cases = {test: case for test, case in found.items() if test.partition("::")[0] == name}
                reached = {path for case in cases.values() for path in case.reached}
                there = {path: digests[path] for path in (name, HELPERS, *reached)}
                record.files[name] = TestFile(there, cases)
        return True

    def _run(self, into: Path, tests: Sequence[str], mark: str, seconds: float) -> bool:
        told = {"files": [str(self.root / path) for path in self.watched], "into": str(into)}
        workers = ["-n", str(self.jobs)] if min(self.jobs, len(tests)) > 1 else ["-p", "no:xdist"]
        with subprocess.Popen(
            [sys.executable, "-m", "pytest", *LEAN, "-p", "mutant_record", *workers, "-m", mark, *tests],
            cwd=self.root,
            env=environment(
                self.root,
                **{PROBED: json.dumps(told), "CI": "true", "HYPOTHESIS_STORAGE_DIRECTORY": str(into)},
            ),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as process:
            try:
                process.wait(seconds)
            except BaseException as error:  # also Ctrl-C
                os.killpg(process.pid, signal.SIGKILL)
                if not isinstance(error, subprocess.TimeoutExpired):
                    raise
                return False
        return True

    def _digests(self) -> dict[str, str]:
        here = Path(__file__).parent
        shared = {here / "mutant_hook.py", *(self.root / "tests").rglob("conftest.py")}
        shared.update((self.root / "tests" / "kits").rglob("*.py"))
        digests = {path: _digest(self.root / path) for path in {*self.watched, *self.tests}}
        helpers = "".join(_digest(file) for file in sorted(shared))
        return digests | {HELPERS: hashlib.sha256(helpers.encode()).hexdigest()}


def _gathered(into: Path, watched: Sequence[str], imported: dict[str, int]) -> dict[str, Case]:
    found: dict[str, Case] = {}
    for file in into.glob("*.tests"):
        told = json.loads(file.read_bytes())
        for path, lines in _by_file(watched, told["imported"]).items():
            imported[path] = imported.get(path, 0) | lines
        for name, (seconds, passed, reached) in told["cases"].items():
            found[name] = Case(seconds, passed, _by_file(watched, reached))
    for file in into.glob("*.beside"):
        test, *numbers = file.read_text().splitlines()
        if test in found:
            for path, lines in _by_file(watched, map(int, numbers)).items():
                found[test].reached[path] = found[test].reached.get(path, 0) | lines
    return found


def _by_file(watched: Sequence[str], numbers: Iterable[int]) -> dict[str, int]:
    found: dict[str, int] = {}
    for number in numbers:
        file, line = divmod(number, LINES)
        found[watched[file]] = found.get(watched[file], 0) | 1 << line
    return found


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


# --- as a plugin of the pytest that records ---


class Recorder:
    """Notes for each test what it reaches."""

    def __init__(self, into: Path) -> None:
        self._into = into
        self._reached: set[int] = set()
        self._imported: list[int] | None = None
        self._cases: dict[str, tuple[float, bool, list[int]]] = {}
        self._bad: set[str] = set()
        setattr(builtins, NOTE, self._reached.add)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        if self._imported is None:
            self._imported = list(self._reached)
        self._reached.clear()
        began = time.perf_counter() - _waited()
        result = yield
        seconds = round(time.perf_counter() - _waited() - began, 4)
        self._cases[item.nodeid] = (seconds, item.nodeid not in self._bad, list(self._reached))
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed or report.skipped:
            self._bad.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        if self._imported is not None:
            told = {"imported": self._imported, "cases": self._cases}
            (self._into / f"{os.getpid()}.tests").write_text(json.dumps(told))


def _waited() -> float:
    """Seconds for which this process could have run, but others did: what a test takes is without them."""
    try:
        return int(Path("/proc/self/schedstat").read_text().split()[1]) / 1e9
    except (OSError, ValueError, IndexError):  # not Linux, or a kernel that doesn't count
        return 0.0


def pytest_configure(config: pytest.Config) -> None:
    """Watch, if that is what this pytest was started for."""
    if PROBED in os.environ:
        config.pluginmanager.register(Recorder(Path(json.loads(os.environ[PROBED])["into"])))
