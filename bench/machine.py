"""What the benchmark runs on, and how it keeps what else runs there out of its figures."""

from __future__ import annotations

import contextlib
import os
import platform
import time
from collections.abc import Generator
from contextlib import contextmanager


def description() -> str:
    """A line for the head of a table."""
    return (
        f"{time.strftime('%Y-%m-%d')}, {len(cores())} cores, {platform.system()} {platform.machine()}, "
        f"{platform.python_implementation()} {platform.python_version()}"
    )


def cores() -> list[int]:
    """What this process may run on."""
    return sorted(os.sched_getaffinity(0))


@contextmanager
def ahead_of_the_rest() -> Generator[None]:
    """While entered, this process and those that it starts run before all others, where that is allowed."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
