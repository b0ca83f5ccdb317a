"""What the fixtures start ends with the tests, also where no teardown runs."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]

ENDLESS = """\
import sys
pytest_plugins = ["canaxis.testing"]

def test_endless(canaxis_service):
    print("here", flush=True)
    sys.stdin.read()
"""
ENDING = 30.0


def children_of(pid: int) -> list[int]:
    found = subprocess.run(
        ["ps", "--ppid", str(pid), "-o", "pid="], capture_output=True, text=True, check=True
    )
    return [int(line) for line in found.stdout.split()]


def test_a_killed_pytest_leaves_no_process_behind(tmp_path: Path) -> None:
    (tmp_path / "test_endless.py").write_text(ENDLESS)
    tests = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-s",
            "-p",
            "no:cacheprovider",
            "-c",
            os.devnull,
            str(tmp_path),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )
    assert tests.stdin is not None
    assert tests.stdout is not None
    with tests.stdin, tests.stdout:
        try:
            assert any(b"here" in line for line in tests.stdout)
            started = [os.pidfd_open(pid) for pid in children_of(tests.pid)]
        finally:
            tests.send_signal(signal.SIGKILL)
            tests.wait()
    try:
        assert len(started) == 2, "a simulator and a service"
        for process in started:
            assert select.select([process], [], [], ENDING)[0], "it runs on"
    finally:
        for process in started:
            os.close(process)
