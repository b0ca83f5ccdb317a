"""How a process that tries a mutant says how far it is; as a program it tries one in a pytest of its own.

That is for what an import alone meets: a module's constants, and what is computed from them. What it says
goes through a pipe: `t` for each test that starts, `F` and its name for one that fails, `S` at the end.
"""

from __future__ import annotations

import os
import resource
import sys

import pytest

STARTS, FAILED, SURVIVED, UNPLANTED = b"t", b"F", b"S", b"X"

MEMORY = 6 << 30
"""Bytes of address space that a process with a fault may take: a loop on a virtual clock never waits."""


class Teller:
    """A plugin for pytest."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe
        self.failed: str | None = None

    def tell(self, what: bytes) -> None:
        os.write(self._pipe, what)

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self, config: pytest.Config) -> None:
        be_silent(config)

    def pytest_runtest_logstart(self) -> None:
        self.tell(STARTS)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._fails(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self._fails(report)

    def _fails(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if report.failed and self.failed is None:
            self.failed = report.nodeid
            print(report.longreprtext, flush=True)
            self.tell(FAILED + report.nodeid.encode() + b"\n")


def be_silent(config: pytest.Config) -> None:
    """Nothing of dots and headlines; the options about them are understood all the same."""
    reporter = config.pluginmanager.getplugin("terminalreporter")
    if reporter is not None:
        config.pluginmanager.unregister(reporter)


def limit_memory() -> None:
    """Of this process and of all that it starts."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def main() -> None:
    """Run pytest with all arguments but the first, which is the pipe."""
    teller = Teller(int(sys.argv[1]))
    code = pytest.main(sys.argv[2:], plugins=[teller])
    if code != 0 and teller.failed is None:
        teller.tell(FAILED + b"(pytest did not begin)\n")
    teller.tell(SURVIVED)


if __name__ == "__main__":
    main()
