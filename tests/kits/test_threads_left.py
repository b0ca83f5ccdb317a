"""The check for threads that are left, in runs of pytest of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

KITS = Path(__file__).parent
FORGETS = "threading.Thread(target=threading.Event().wait, name='forgotten', daemon={daemon}).start()"
TESTS = """
import threading
import pytest

{at_import}

def test_one():
    {in_one}

def test_two():
    {in_two}

@pytest.fixture(scope="module")
def shared():
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    yield
    over.set()
    thread.join()

def test_three(shared):
    pass

def test_four(shared):
    pass
"""


def run(
    folder: Path, workers: int, *, at_import: str = "", in_one: str = "pass", in_two: str = "pass"
) -> tuple[int, str]:
    """Exit code and output of pytest over `TESTS`; fails if it doesn't end."""
    (folder / "test_it.py").write_text(TESTS.format(at_import=at_import, in_one=in_one, in_two=in_two))
    (folder / "conftest.py").write_text("import threads_left\nthreads_left.ENDING = 0.1\n")
    (folder / "pytest.ini").write_text(f"[pytest]\npythonpath = {KITS}\n")
    arguments = ["-p", "threads_left", "-p", "no:cacheprovider", "-n", str(workers), str(folder)]
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", *arguments],
        check=False,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=50,
    )
    return ended.returncode, ended.stdout


@pytest.mark.process
def test_a_test_that_forgets_a_thread_fails_itself_and_pytest_ends(tmp_path: Path) -> None:
    forgets, forgets_daemon = (FORGETS.format(daemon=daemon) for daemon in (False, True))
    code, output = run(tmp_path, 0, in_one=forgets, in_two=forgets_daemon)
    assert code == 1, output
    for test in ("one", "two"):
        assert f"ERROR test_it.py::test_{test} - AssertionError: threads left behind" in output
    assert "4 passed, 2 errors" in output, "nobody else is blamed, least of all for a thread that is shared"


@pytest.mark.process
@pytest.mark.parametrize("workers", [0, 1])
def test_a_thread_that_is_no_test_s_fails_the_run_which_ends(tmp_path: Path, workers: int) -> None:
    code, output = run(tmp_path, workers, at_import=FORGETS.format(daemon=False))
    assert code == 1, output
    assert "4 passed" in output
    assert "threads that would have kept pytest from ending" in output
    assert "<Thread(forgotten, started" in output
