"""Every part of the benchmark runs: one short round, in a process of its own. No timing is judged."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from repository import ROOT

from bench.parts import PARTS

pytestmark = [pytest.mark.process, pytest.mark.slow]


@pytest.mark.timeout(180)
@pytest.mark.parametrize("name", PARTS)
def test_a_short_round_of_each_part_gives_its_rows(name: str):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "bench", "--only", name, "--rounds", "1", "--seconds", "0.1"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=170,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if line.startswith("| ")]
    assert len(rows) >= 2, done.stdout
