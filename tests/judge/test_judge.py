"""Random commands of four clients over three restarts (SIGKILL); `make judge` gives ten thousand."""

from __future__ import annotations

from pathlib import Path

import pytest
from judge_run import run

pytestmark = [pytest.mark.process, pytest.mark.slow, pytest.mark.timeout(300)]


def test_each_command_is_carried_out_once_ends_right_and_is_never_lost(tmp_path: Path) -> None:
    verdict = run(tmp_path, 300, restarts=3, seed=1)
    assert not verdict.complaints, "\n".join(verdict.complaints[:20])
    assert verdict.counts["move: succeeded"] > 20, verdict.counts
    assert verdict.counts["leases"], verdict.counts
