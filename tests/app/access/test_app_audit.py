"""The record of commands: what a line says, and that a broken disk disturbs nobody."""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path

from app.access.audit import AuditTrail
from app.configuration.configuration import AuditConfiguration


def files_in(folder: Path) -> list[Path]:
    return list(folder.iterdir())


def entry(number: int) -> dict[str, object]:
    return {"who": "a", "method": "POST", "path": "/api/v1/stop", "status": 200, "number": number}


async def test_lines_are_added_private_and_rotated(tmp_path: Path) -> None:
    file = tmp_path / "audit.jsonl"
    for start in (0, 200):  # two runs of the service
        trail = AuditTrail(AuditConfiguration(file=file, max_bytes=10_000, keep=9))
        trail.open()
        for number in range(start, start + 200):
            trail.note(entry(number))
        await trail.close()
        assert (trail.lost, trail.problem) == (0, None)
    files = files_in(tmp_path)
    assert len(files) > 3
    lines = [json.loads(line) for path in files for line in path.read_text().splitlines()]
    assert sorted(line["number"] for line in lines) == list(range(400))
    assert all(line["time"].endswith("Z") for line in lines)
    assert {path.stat().st_mode & 0o777 for path in files} == {0o600}
    assert all(path.stat().st_size <= 10_000 for path in files)


async def test_a_file_that_can_not_be_written_is_said_and_counted_and_comes_back(tmp_path: Path) -> None:
    folder = tmp_path / "missing"
    trail = AuditTrail(AuditConfiguration(file=folder / "audit.jsonl"))
    trail.open()
    trail.note(entry(1))
    await trail.close()
    assert trail.lost == 1
    assert trail.problem == "No such file or directory"
    folder.mkdir()
    trail.open()
    trail.note(entry(2))
    await trail.close()
    assert trail.problem is None
    assert json.loads((folder / "audit.jsonl").read_text())["number"] == 2


async def test_a_full_disk_is_said(tmp_path: Path) -> None:
    if sys.platform != "linux":
        return  # which alone has a disk that is always full
    link = tmp_path / "audit.jsonl"
    link.symlink_to("/dev/full")
    trail = AuditTrail(AuditConfiguration(file=link))
    trail.open()
    trail.note(entry(1))
    await trail.close()
    assert trail.problem == "No space left on device"
    assert trail.lost >= 1


async def test_without_a_file_there_is_no_thread() -> None:
    before = threading.active_count()
    trail = AuditTrail(AuditConfiguration())
    trail.open()
    trail.note(entry(1))
    assert threading.active_count() == before
    await trail.close()
