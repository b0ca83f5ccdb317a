"""The store on a real file: what is durable, and what happens when the disk or the file is bad."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from pathlib import Path

import pytest

from app.store.database import Database, StoreOff
from app.store.schema import MIGRATIONS
from app.store.sqlite import Statement


def key(name: str, size: int = 1) -> Statement:
    return Statement(
        "INSERT OR REPLACE INTO keys (key, born, fingerprint) VALUES (?, 0, ?)", (name, b"x" * size)
    )


async def names(store: Database) -> list[str]:
    return [row[0] for row in await store.rows("SELECT key FROM keys ORDER BY key")]


async def until(store: Database, *, on: bool) -> None:
    async with asyncio.timeout(10):
        while store.health.on is not on:  # noqa: ASYNC110 - only the store knows
            await asyncio.sleep(0.01)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "canaxis.db"


async def test_what_was_committed_is_there_for_the_next_one(path: Path) -> None:
    first = Database(path)
    await first.open()
    assert await first.commit(key("a"), key("b"))
    with sqlite3.connect(path) as other:  # durable now, not only after close
        assert other.execute("SELECT count(*) FROM keys").fetchone() == (2,)
        assert other.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    other.close()
    first.later(key("c"))
    await first.close()
    second = Database(path)
    await second.open()
    assert await names(second) == ["a", "b", "c"]
    await second.close()


async def test_writes_and_questions_keep_their_order() -> None:
    store = Database(None)
    await store.open()
    for name in "dacb":
        store.later(key(name))
    assert await names(store) == ["a", "b", "c", "d"]
    await store.close()


async def test_a_full_disk_turns_history_off_and_it_comes_back(path: Path) -> None:
    store = Database(path, retry=0.05)
    returned: list[bool] = []
    store.on_return.append(lambda: returned.append(True))
    await store.open()
    await store.rows("PRAGMA max_page_count = 20")
    assert not await store.commit(key("big", 1_000_000))
    assert not store.health.on
    assert "full" in store.health.reason
    assert not await store.commit(key("lost"))
    store.later(key("lost too"))
    assert store.dropped == 3
    with pytest.raises(StoreOff, match="full"):
        await names(store)
    await until(store, on=True)
    assert returned == [True]
    assert await store.commit(key("kept"))
    assert await names(store) == ["kept"]
    await store.close()


NOTES = b"somebody's notes, not a database. " * 100


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    path = tmp_path / "notes.txt"
    path.write_bytes(NOTES)
    return path


async def test_a_file_that_is_no_database_is_left_alone(notes: Path) -> None:
    store = Database(notes)
    await store.open()
    assert not store.health.on
    assert "not a database" in store.health.reason
    assert not await store.commit(key("a"))
    await store.close()
    assert notes.read_bytes() == NOTES  # noqa: ASYNC240 - nothing else runs


async def test_a_folder_that_does_not_let_us_write_is_no_reason_to_fail(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = Database(tmp_path / "file" / "canaxis.db")
    await store.open()
    assert not store.health.on
    await store.close()


async def test_two_services_never_share_a_file(path: Path) -> None:
    first, second = Database(path), Database(path, retry=0.05)
    await first.open()
    await second.open()
    assert not second.health.on
    assert "another service uses it" in second.health.reason
    await first.close()
    await until(second, on=True)
    await second.close()


async def test_a_file_of_a_newer_version_is_not_touched(path: Path) -> None:
    path.parent.mkdir()
    with sqlite3.connect(path) as newer:
        newer.execute(f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
    newer.close()
    store = Database(path)
    await store.open()
    assert "newer Canaxis" in store.health.reason
    await store.close()


@pytest.mark.parametrize("version", range(len(MIGRATIONS)))
async def test_every_earlier_version_is_brought_up(path: Path, version: int) -> None:
    path.parent.mkdir()
    older = sqlite3.connect(path)
    for script in MIGRATIONS[:version]:
        older.executescript(script)
    older.execute(f"PRAGMA user_version = {version}")
    older.commit()
    older.close()
    store = Database(path)
    await store.open()
    assert store.health.on, store.health.reason
    assert await store.rows("PRAGMA user_version") == [(len(MIGRATIONS),)]
    await store.close()


async def test_a_disk_that_hangs_holds_a_command_up_only_for_the_patience(path: Path) -> None:
    store = Database(path, retry=0.05, patience=0.3)
    await store.open()
    assert await store.commit(key("a"))
    holder = sqlite3.connect(path, isolation_level=None)
    holder.execute("BEGIN EXCLUSIVE")  # as a slow disk would, it keeps every writer waiting
    try:
        assert not await store.commit(key("b"))
        assert not store.health.on
    finally:
        holder.execute("ROLLBACK")
        holder.close()
    await until(store, on=True)
    assert await store.commit(key("c"))
    await store.close()


async def test_it_closes_though_its_worker_was_cancelled_first(path: Path) -> None:
    """As at the end of an event loop; an open connection's thread would keep the process from ending."""
    store = Database(path)
    before = set(threading.enumerate())
    await store.open()
    threads = set(threading.enumerate()) - before
    assert threads
    worker = next(task for task in asyncio.all_tasks() if task.get_name() == "store")
    worker.cancel()
    await asyncio.wait({worker})
    await store.close()
    assert not store.health.on
    for thread in threads:
        await asyncio.to_thread(thread.join, 10)
        assert not thread.is_alive()
