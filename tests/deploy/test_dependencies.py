"""What the source imports is what pyproject.toml declares, in both directions."""

from __future__ import annotations

import subprocess
import sys

from repository import ROOT


def test_every_import_is_declared_and_every_dependency_imported() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "deptry", "."],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
