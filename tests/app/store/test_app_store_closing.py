"""The end of a store: on a disk that hangs, half open, cancelled, twice."""

from __future__ import annotations

import asyncio
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hanging_disk import CLOSE, HangingDisk, hanging_disk

from app.store.database import Database, StoreOff
from app.store.sqlite import THREAD, Statement


def key(name: str) -> Statement:
    return Statement("INSERT INTO keys (key, born, fingerprint) VALUES (?, 0, x'')", (name,))


def keys_in(path: Path) -> list[str]:
    file = sqlite3.connect(path)
    try:
        return [row[0] for row in file.execute("SELECT key FROM keys ORDER BY key")]
    finally:
        file.close()


def threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == THREAD]


async def until_free(path: Path) -> None:
    """Until what held the file has let go of it."""
    store = Database(path, retry=0.01)
    await store.open()
    async with asyncio.timeout(10):
        while not store.health.on:  # noqa: ASYNC110 - only the store knows
            await asyncio.sleep(0.01)
    await store.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "canaxis.db"


@pytest.fixture
def in_the_way(path: Path) -> Path:
    path.mkdir()
    return path


@pytest.fixture
def disk() -> Iterator[HangingDisk]:
    with hanging_disk() as disk:
        yield disk


async def test_a_closed_store_has_no_thread_any_more(path: Path) -> None:
    store = Database(path)
    await store.open()
    assert len(threads()) == 1
    store.later(key("a"))
    await store.close()
    assert threads() == []
    assert keys_in(path) == ["a"]


async def test_nor_has_one_that_could_never_be_opened(in_the_way: Path) -> None:
    store = Database(in_the_way)
    await store.open()
    assert "unable to open" in store.health.reason
    assert threads() == []
    await store.close()


async def test_what_is_asked_of_a_closed_store_is_refused_at_once(path: Path) -> None:
    store = Database(path, patience=60)
    await store.open()
    await store.close()
    assert not await store.commit(key("a"))
    store.later(key("b"))
    assert store.dropped == 2
    with pytest.raises(StoreOff, match="closed"):
        await store.rows("SELECT key FROM keys")
    assert keys_in(path) == []


async def test_it_can_be_closed_twice_also_at_once_and_before_it_was_opened(path: Path) -> None:
    await Database(path).close()
    store = Database(path)
    await store.open()
    store.later(key("a"))
    await asyncio.gather(store.close(), store.close())
    await store.close()
    assert keys_in(path) == ["a"]


def test_a_write_that_hangs_at_the_end_is_left_to_itself(
    disk: HangingDisk, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """It may come to its end later, when the event loop is closed and another one runs."""

    async def life() -> None:
        store = Database(path, patience=0.1)
        await store.open()
        disk.hang_in("COMMIT")
        store.later(key("late"))
        await disk.reached()
        waiting = [
            asyncio.create_task(store.commit(key("never"))),
            asyncio.create_task(store.rows("SELECT 1")),
        ]
        await asyncio.sleep(0)
        await store.close()
        assert store.health.reason == "The store is closed."
        answers = await asyncio.gather(*waiting, return_exceptions=True)
        assert answers[0] is False
        assert isinstance(answers[1], StoreOff)

    async def afterlife() -> None:
        second = Database(path)
        await second.open()
        assert "another service uses it" in second.health.reason, "the write is still under way"
        await second.close()
        disk.go_on()
        await until_free(path)

    asyncio.run(life())
    asyncio.run(afterlife())
    assert keys_in(path) == ["late"]
    assert not caplog.records, "nobody stumbles over the late answer"


@pytest.mark.parametrize("place", ["INSERT", CLOSE])
async def test_a_close_that_is_cancelled_waits_for_no_disk(disk: HangingDisk, path: Path, place: str) -> None:
    store = Database(path, patience=60)
    await store.open()
    disk.hang_in(place)
    committing = asyncio.create_task(store.commit(key("a")))
    await asyncio.sleep(0)
    closing = asyncio.create_task(store.close())
    await disk.reached()
    closing.cancel()
    async with asyncio.timeout(10):
        await asyncio.wait({closing})
        assert await committing is (place == CLOSE), "whoever waits is told"
    assert closing.cancelled()
    assert store.health.reason == "The store is closed."
    disk.go_on()
    await until_free(path)


@pytest.mark.parametrize("place", ["PRAGMA journal_mode", "BEGIN"])
async def test_an_open_that_is_cancelled_leaves_nothing(disk: HangingDisk, path: Path, place: str) -> None:
    store = Database(path, patience=60)
    disk.hang_in(place)
    opening = asyncio.create_task(store.open())
    await disk.reached()
    opening.cancel()
    async with asyncio.timeout(10):
        await asyncio.wait({opening})
    assert opening.cancelled()
    await store.close()
    disk.go_on()
    await until_free(path)


async def test_a_store_that_is_closed_while_it_comes_back_leaves_nothing(
    disk: HangingDisk, in_the_way: Path
) -> None:
    store = Database(in_the_way, retry=0.01, patience=0.05)
    await store.open()
    disk.hang_in("PRAGMA journal_mode")
    in_the_way.rmdir()  # noqa: ASYNC240 - nothing is in it
    await disk.reached()
    await store.close()
    disk.go_on()
    await until_free(in_the_way)


HANGS = """
import asyncio, sys, threading
from pathlib import Path
from hanging_disk import hanging_disk
from app.store.sqlite import Statement
from app.store.database import Database

async def life(disk):
    store = Database(Path(sys.argv[1]), patience=0.1)
    await store.open()
    disk.hang_in("CREATE")
    store.later(Statement("CREATE TABLE more (n)"))
    await disk.reached()
    await store.close()
    print("closed", flush=True)
    disk.go_on = lambda: None

with hanging_disk() as disk:
    asyncio.run(life(disk))
"""


@pytest.mark.process
def test_a_disk_that_hangs_for_good_does_not_keep_the_process(path: Path) -> None:
    kits = Path(__file__).parents[2] / "kits"
    ended = subprocess.run(
        [sys.executable, "-c", HANGS, str(path)],
        check=False,
        env={"PYTHONPATH": str(kits)},
        capture_output=True,
        text=True,
        timeout=50,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "closed" in ended.stdout
