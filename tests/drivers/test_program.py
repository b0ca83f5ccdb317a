"""Processes of ours, started where others have packages of our names."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from drivers import program


@pytest.mark.process
@pytest.mark.parametrize(("module", "said"), [("drivers.cyclic.child", ""), ("app", "canaxis 0")])
def test_a_process_of_ours_is_ours(tmp_path: Path, module: str, said: str) -> None:
    for name in ("app", "drivers"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('not yours')")
    done = subprocess.run(
        program.command(module, "--version"),
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": "."},
        stdin=subprocess.DEVNULL,  # at whose end the sender of set points ends as well
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(said)
