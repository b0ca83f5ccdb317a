"""Where faults are planted, and which tests are to find them. The one place to change either."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Sequence
from pathlib import Path

FILES = (
    "drivers/cia402/**.py",
    "drivers/cyclic/**.py",
    "drivers/master/**.py",
    "app/axes/**.py",
    "app/coordinated/**.py",
    "app/jog/**.py",
    "app/leases/**.py",
    "app/moves/**.py",
    "app/operations/**.py",
    "app/positions/**.py",
    "app/stop/**.py",
    "app/trajectories/**.py",
)
"""What moves motors: patterns in which `**` stands for any folders."""

LEFT_ALONE = (
    "**/__init__.py",
    "**/schemas.py",
    "**/schemas/**",
    "drivers/master/**timing.py",  # how long is long enough is no behaviour that a test holds
)
"""Patterns of files in which none is planted."""

OTHER_TESTS = (
    "tests/bench/**",
    "tests/canaxis/**",
    "tests/canaxis_command/**",
    "tests/contract/**",
    "tests/deploy/**",
    "tests/drivers/bus/**",
    "tests/drivers/cia301/**",
    "tests/drivers/devices/**",
    "tests/drivers/sim/**",
    "tests/fuzz/**",
    "tests/interop/**",
    "tests/judge/**",
    "tests/mutants/**",
    "tests/process/**",
    "tests/seeds/**",
    "tests/socketcan/**",
)
"""Patterns of test files that take no part: they are about something else, draw by chance, or take too long.
What only they find has no test of its own.
"""

MARKED = "not process and not socketcan and not slow"
"""Which of the others take part, by their marks."""

BESIDE = ("tests/process/test_process_sender.py",)
"""Test files that take part whatever their marks: what they start in processes carries the fault too."""


def chosen(root: Path, patterns: Sequence[str], without: Sequence[str] = ()) -> list[str]:
    """The files below `root` that match one of the patterns and none of `without`, as paths from there."""
    found = {path for pattern in patterns for path in _below(root, pattern)}
    return sorted(path for path in found if not any(matches(path, pattern) for pattern in without))


def matches(path: str, pattern: str) -> bool:
    """Whether the whole path matches; `*` and `**` both match slashes too."""
    return fnmatch.fnmatchcase(path, pattern) or fnmatch.fnmatchcase(path, pattern.replace("**/", ""))


def _below(root: Path, pattern: str) -> Iterator[str]:
    fixed = pattern.partition("*")[0].rpartition("/")[0] if "*" in pattern else pattern
    start = root / fixed
    for file in [start] if start.is_file() else start.rglob("*.py"):
        path = file.relative_to(root).as_posix()
        if matches(path, pattern):
            yield path
