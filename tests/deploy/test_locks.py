"""The lock files: every dependency pinned and hashed, from no named place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from repository import ROOT

LOCKS = sorted(ROOT.glob("requirements*.lock"))


@pytest.mark.parametrize("lock", LOCKS, ids=lambda path: path.name)
def test_every_dependency_is_pinned_and_hashed_and_no_host_is_named(lock: Path) -> None:
    text = lock.read_text(encoding="utf-8")
    requirements = text.replace("\\\n", " ").splitlines()
    assert requirements
    for requirement in requirements:
        assert re.match(r"[A-Za-z0-9_.\[\]-]+==\S+ ", requirement), requirement
        assert "--hash=sha256:" in requirement
    for place in ("://", "--index-url", "--extra-index-url", "--find-links", " @ "):
        assert place not in text


def test_there_are_locks_for_running_and_for_developing() -> None:
    assert {"requirements.lock", "requirements-dev.lock"} <= {lock.name for lock in LOCKS}
