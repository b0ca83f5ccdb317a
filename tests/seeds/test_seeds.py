"""A fixed budget of seeds: each is a run with faults and commands drawn from it (docs/testing.md).

`make soak` plays many more.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from repository import ROOT
from seed_run import run

CHUNKS = 18
SEEDS_IN_A_CHUNK = 5
QUICK = 3
"""Chunks that are played each time; the others are among the slow tests."""


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "chunk", [*range(QUICK), *(pytest.param(n, marks=pytest.mark.slow) for n in range(QUICK, CHUNKS))]
)
def test_every_invariant_holds_at_every_instant_of_every_seed(chunk: int) -> None:
    for seed in range(chunk * SEEDS_IN_A_CHUNK, (chunk + 1) * SEEDS_IN_A_CHUNK):
        outcome = run(seed)
        assert outcome.violation is None, str(outcome)


def test_a_seed_plays_the_same_again_and_in_another_process() -> None:
    seed = 5
    here, again = run(seed), run(seed)
    assert (here.digest, here.lines, here.seconds) == (again.digest, again.lines, again.seconds)
    told = subprocess.run(
        [sys.executable, "tests/seeds", "--seed", str(seed)],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": "4711", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    assert here.digest in told.stdout


def test_two_seeds_play_differently() -> None:
    assert run(5).digest != run(6).digest
