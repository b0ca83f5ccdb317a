"""Tries mutants: each in a process of its own, forked from one that has collected the tests already."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import selectors
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from types import FunctionType
from typing import NoReturn

import pytest
from mutant import Mutant
from mutant_hook import PLANTED, environment
from mutant_record import LEAN, Case, Record
from mutant_swap import Key, functions_of, plant
from mutant_teller import FAILED, STARTS, SURVIVED, UNPLANTED, Teller, be_silent, limit_memory

FACTOR = 10.0
"""How many times what it took when it was recorded a test may take, and some slack."""
STARTING = 120.0
"""Seconds that a process may take until its first test starts."""


class Verdict(Enum):
    """What became of a mutant."""

    FOUND = "found by a test that failed"
    HUNG = "found since a test did not end"
    DIED = "found since the process ended"
    SURVIVED = "survived"
    UNREACHED = "reached by no test"
    UNTRIED = "could not be tried"


@dataclass
class Outcome:
    """The end of one trial."""

    mutant: Mutant
    verdict: Verdict
    tests: list[str]
    """Those that ran; the last one found it, if one did."""
    reaching: int
    """How many tests reach the statement."""


@dataclass
class _Trial:
    mutant: Mutant
    tests: list[str]
    reaching: int
    pid: int
    pipe: int
    folder: str
    ends: float
    """When it hangs, on the monotonic clock."""
    said: bytes = b""


def reaching(mutant: Mutant, record: Record, cases: dict[str, Case]) -> list[str]:
    """The tests that reach a mutant; of what an import meets, those that go on into the file, or else all."""
    if met_by_import(mutant, record):
        return [name for name, case in cases.items() if mutant.file in case.reached] or list(cases)
    assert mutant.reached is not None
    return [name for name, case in cases.items() if case.reached.get(mutant.file, 0) >> mutant.reached & 1]


def met_by_import(mutant: Mutant, record: Record) -> bool:
    """Whether the fault counts already when its file is imported."""
    lines = record.imported.get(mutant.file, 0)
    return not mutant.functions or mutant.reached is None or bool(lines >> mutant.reached & 1)


def ordered(mutant: Mutant, tests: Sequence[str], cases: dict[str, Case], patience: float) -> list[str]:
    """Those that run, in this order, until they take `patience` seconds.

    First those that lie where the mutant's tests lie, for half of the time; then all others. Of each file the
    fastest, then of each the second fastest, and so on: the fastest find most, and different files look at
    different things.
    """
    by_file: dict[str, list[str]] = {}
    for name in sorted(tests, key=lambda name: cases[name].seconds):
        by_file.setdefault(name.partition("::")[0], []).append(name)
    ranks = {name: rank for names in by_file.values() for rank, name in enumerate(names)}
    ranked = sorted(tests, key=lambda name: (ranks[name], cases[name].seconds, name))
    room = f"tests/{mutant.file.rpartition('/')[0]}/"
    near = _within(patience / 2, [name for name in ranked if name.startswith(room)], cases)
    left = patience - sum(cases[name].seconds for name in near)
    return near + _within(left, [name for name in ranked if name not in near], cases)


def _within(seconds: float, tests: Sequence[str], cases: dict[str, Case]) -> list[str]:
    """The first of them that take no longer; one at least."""
    found: list[str] = []
    for name in tests:
        seconds -= cases[name].seconds
        if found and seconds < 0:
            break
        found.append(name)
    return found


@dataclass(eq=False)
class Trials:
    """A plugin for pytest that tries mutants instead of running the collected tests."""

    root: Path
    record: Record
    jobs: int = 2
    patience: float = 10.0
    """Seconds of tests, as recorded, for each mutant."""
    slack: float = 5.0
    """Seconds that a test may take in any case."""
    until: float = float("inf")
    """On the monotonic clock: what is not over then counts as not tried."""
    told: Callable[[Outcome], None] = lambda outcome: None
    output: int | None = None
    """Where what the tests print goes, a file's number."""
    _waiting: list[Mutant] = field(default_factory=list, init=False)
    _cases: dict[str, Case] = field(default_factory=dict, init=False)
    _items: dict[str, pytest.Item] = field(default_factory=dict, init=False)
    _functions: dict[Key, list[FunctionType]] = field(default_factory=dict, init=False)
    _teller: Teller | None = field(default=None, init=False)
    _began: bool = field(default=False, init=False)
    _anew: set[Mutant] = field(default_factory=set, init=False)
    """Those that could not be planted in what is imported already."""

    def run(self, mutants: Sequence[Mutant]) -> None:
        """Try them in this order, and tell each outcome, until they or the time are over."""
        self._cases = self.record.cases()
        self._waiting = list(reversed(mutants))
        tests = {name.partition("::")[0] for name in self._tests_of_all(mutants)}
        os.environ["CI"] = "true"  # hypothesis draws the same each time then
        sys.path.insert(0, str(self.root))
        if not tests:
            self._try_all()
            return
        pytest.main([*LEAN, "-p", "no:xdist", "-s", *sorted(tests)], plugins=[self])
        if not self._began:
            raise SystemExit("The tests can't be collected.")

    def _tests_of_all(self, mutants: Sequence[Mutant]) -> set[str]:
        if len(mutants) > 50:
            return set(self._cases)
        return {name for mutant in mutants for name in reaching(mutant, self.record, self._cases)}

    # --- hooks ---

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self, config: pytest.Config) -> None:
        be_silent(config)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self._began = True
        self._items = {item.nodeid: item for item in session.items}
        self._functions = functions_of(self.root, {mutant.file for mutant in self._waiting})
        gc.collect()
        gc.freeze()  # what is here already is looked through by no process that is forked
        self._try_all()
        return True

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        if self._teller is not None:
            self._teller.pytest_runtest_logstart()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if self._teller is not None:
            self._teller.pytest_runtest_logreport(report)

    # --- trials ---

    def _try_all(self) -> None:
        running: dict[int, _Trial] = {}
        with selectors.DefaultSelector() as selector:
            try:
                while True:
                    while self._waiting and len(running) < self.jobs and time.monotonic() < self.until:
                        trial = self._begin(self._waiting.pop())
                        if trial is not None:
                            running[trial.pipe] = trial
                            selector.register(trial.pipe, selectors.EVENT_READ)
                    if not running or time.monotonic() >= self.until:
                        return
                    for key, _ in selector.select(0.2):
                        self._hear(running[key.fd])
                    for trial in list(running.values()):
                        if trial.said[-1:] == b"\0" or time.monotonic() > trial.ends:
                            selector.unregister(running.pop(trial.pipe).pipe)
                            self._end(trial)
            finally:
                for trial in running.values():
                    _clean_up(trial)

    def _begin(self, mutant: Mutant) -> _Trial | None:
        found = reaching(mutant, self.record, self._cases)
        here = [name for name in found if name in self._items]
        tests = ordered(mutant, here, self._cases, self.patience)
        if not tests:
            self.told(Outcome(mutant, Verdict.UNREACHED, [], len(found)))
            return None
        folder = tempfile.mkdtemp(prefix="mutant")
        ours, theirs = os.pipe()
        anew = mutant in self._anew or met_by_import(mutant, self.record)
        pid = os.fork()
        if pid == 0:
            self._in_child(mutant, tests, theirs, folder, anew=anew)
        os.close(theirs)
        return _Trial(mutant, tests, len(found), pid, ours, folder, time.monotonic() + STARTING)

    def _environment(self, mutant: Mutant, folder: str) -> dict[str, str]:
        planted = json.dumps({"file": str(self.root / mutant.file), "index": mutant.index})
        temporary = {"TMPDIR": folder, "PYTEST_DEBUG_TEMPROOT": folder}
        return environment(
            self.root, **{PLANTED: planted, "HYPOTHESIS_STORAGE_DIRECTORY": folder, **temporary}
        )

    def _in_child(
        self, mutant: Mutant, tests: Sequence[str], pipe: int, folder: str, *, anew: bool
    ) -> NoReturn:
        """Run the tests until one fails, here or in a pytest that begins `anew`; never returns."""
        try:
            os.setsid()
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            null = os.open(os.devnull, os.O_RDWR)
            for stream, file in enumerate((null, self.output or null, self.output or null)):
                os.dup2(file, stream)
            limit_memory()
            os.environ.update(self._environment(mutant, folder))
            tempfile.tempdir = None
            if anew:
                os.set_inheritable(pipe, True)
                teller = str(Path(__file__).with_name("mutant_teller.py"))
                options = [*LEAN, "-x", "-s", "-p", "no:xdist"]
                os.execv(sys.executable, [sys.executable, teller, str(pipe), *options, *tests])
            self._teller = Teller(pipe)
            if plant(self.root, mutant, self._functions):
                self._run_here([self._items[name] for name in tests])
                self._teller.tell(SURVIVED)
            else:
                self._teller.tell(UNPLANTED)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(0)

    def _run_here(self, items: Sequence[pytest.Item]) -> None:
        assert self._teller is not None
        for item, following in zip(items, [*items[1:], None], strict=True):
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if self._teller.failed is not None:
                return

    def _hear(self, trial: _Trial) -> None:
        piece = os.read(trial.pipe, 65536)
        trial.said += piece or b"\0"
        if piece == STARTS * len(piece) and piece:
            test = trial.tests[min(trial.said.count(STARTS), len(trial.tests)) - 1]
            trial.ends = time.monotonic() + self.slack + FACTOR * self._cases[test].seconds

    def _end(self, trial: _Trial) -> None:
        _clean_up(trial)
        starts, _, failed = trial.said.rstrip(b"\0").partition(FAILED)
        ran = trial.tests[: starts.count(STARTS)]
        if UNPLANTED in starts and trial.mutant not in self._anew:
            self._anew.add(trial.mutant)
            self._waiting.append(trial.mutant)
        elif failed:
            self._say(trial, Verdict.FOUND, [*ran[:-1], failed.partition(b"\n")[0].decode()])
        elif starts.endswith(SURVIVED):
            self._say(trial, Verdict.SURVIVED, ran)
        elif not ran:
            self._say(trial, Verdict.UNTRIED, [])
        else:
            self._say(trial, Verdict.DIED if trial.said.endswith(b"\0") else Verdict.HUNG, ran)

    def _say(self, trial: _Trial, verdict: Verdict, tests: list[str]) -> None:
        self.told(Outcome(trial.mutant, verdict, tests, trial.reaching))


def _clean_up(trial: _Trial) -> None:
    """End the process and all that its tests started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(trial.pid, signal.SIGKILL)
    with contextlib.suppress(ProcessLookupError):
        os.kill(trial.pid, signal.SIGKILL)
    with contextlib.suppress(ChildProcessError):
        os.waitpid(trial.pid, 0)
    os.close(trial.pipe)
    shutil.rmtree(trial.folder, ignore_errors=True)
