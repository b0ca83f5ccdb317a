"""A plugin of pytest: a thread that outlives its test fails that test, and none keeps pytest from ending.

What a forgotten thread does would else be seen in another test, which is innocent, or never: pytest waits for
it at its end for as long as it runs, and no time-out bounds that.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Generator, Iterable
from typing import Any
from weakref import WeakSet

import pytest

ENDING = 5.0
"""Seconds that threads get for their last steps, once whoever started them has closed them."""

BEFORE = pytest.StashKey[set[threading.Thread]]()
"""Of a test: what ran before its first fixture."""
LEFT = pytest.StashKey[list[str]]()
"""Of the run: threads that would keep a process from ending."""
SHARED: WeakSet[threading.Thread] = WeakSet()
"""Threads of fixtures that outlive a test: they belong to no test."""


def still_running(threads: Iterable[threading.Thread]) -> list[threading.Thread]:
    """Those that don't end in time."""
    deadline = time.monotonic() + ENDING
    looked_at = list(threads)
    for thread in looked_at:
        thread.join(max(0.0, deadline - time.monotonic()))
    return [thread for thread in looked_at if thread.is_alive()]


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any]) -> Generator[None, object, object]:
    """Note whose threads are shared."""
    if fixturedef.scope == "function":
        return (yield)
    before = set(threading.enumerate())
    try:
        return (yield)
    finally:
        SHARED.update(set(threading.enumerate()) - before)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    """Note what runs before the first fixture."""
    item.stash[BEFORE] = set(threading.enumerate())
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, object, object]:
    """Fail the test that left a thread, after its last fixture and its event loop have ended."""
    result = yield
    left = still_running(set(threading.enumerate()) - item.stash[BEFORE] - set(SHARED))
    assert not left, f"threads left behind: {left}"
    return result


# --- the end of the run ---


def pytest_configure(config: pytest.Config) -> None:
    """Nothing is left yet."""
    config.stash[LEFT] = []


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """A worker has ended: what it left is ours to tell."""
    node.config.stash[LEFT] += getattr(node, "workeroutput", {}).get("threads_left", [])


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run that left threads which would keep its process, or a worker's, from ending."""
    left = session.config.stash[LEFT]
    left += [repr(thread) for thread in still_running(_holding())]
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["threads_left"] = left  # pyright: ignore[reportAttributeAccessIssue] - xdist puts it there
    if left and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Name what was left."""
    if config.stash[LEFT]:
        terminalreporter.section("threads that would have kept pytest from ending", red=True)
        for thread in config.stash[LEFT]:
            terminalreporter.write_line(thread)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_unconfigure(config: pytest.Config) -> Generator[None]:
    """End the process here, after all else was cleared away, if a thread would not let it end."""
    yield
    session: pytest.Session | None = config.pluginmanager.get_plugin("session")
    if session is not None and _holding():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(int(session.exitstatus))


def _holding() -> list[threading.Thread]:
    """What Python waits for at its end."""
    own = threading.main_thread()
    return [thread for thread in threading.enumerate() if thread is not own and not thread.daemon]
