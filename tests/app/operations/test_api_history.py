"""Operations over HTTP with a store on a real file: what is written down, and what a restart finds."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest
from api_bench import Bench, never_begun, running

from app.configuration.configuration import Configuration, StoreConfiguration
from app.operations.register import OperationRegister
from app.store.database import Database
from app.store.sqlite import Statement

pytestmark = pytest.mark.looptime


def configuration(path: Path, **more: object) -> Configuration:
    return Configuration(store=StoreConfiguration(file=path, **more))  # pyright: ignore[reportArgumentType]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "canaxis.db"


@pytest.fixture
async def bench(path: Path) -> AsyncIterator[Bench]:
    async with running(configuration(path)) as bench:
        await bench.until_ready()
        await bench.enable()
        yield bench


async def test_what_ended_is_told_after_a_restart_with_its_evidence(path: Path) -> None:
    async with running(configuration(path)) as bench:
        await bench.until_ready()
        await bench.enable()
        before = (await bench.move(3000, wait=20)).json()
        assert before["state"] == "succeeded"
    async with running(configuration(path)) as bench:
        after = (await bench.get(f"/operations/{before['id']}")).json()
        listed = (await bench.get("/operations")).json()["operations"]
    assert after == before == listed[0]
    (track,) = after["evidence"]["axes"]
    assert (track["start"]["steps"], track["target"]["steps"], track["end"]["steps"]) == (0, 3000, 3000)
    words = [int(sight["statusword"], 16) for sight in after["evidence"]["statuswords"]]
    assert any(word & 1 << 14 for word in words), "it was seen to move"
    assert words[-1] & 1 << 10
    assert not words[-1] & 1 << 14
    assert after["asked_by"] == {"name": "anonymous", "address": "127.0.0.1"}


async def test_an_operation_is_written_down_before_anything_is_sent(bench: Bench, path: Path) -> None:
    seen: list[tuple[int, str]] = []
    start = bench.service.network.node(1).axis(0).move_to

    def look_first(*args: object, **kwargs: object) -> object:
        with sqlite3.connect(path) as file:
            seen.extend(file.execute("SELECT count(*), max(state) FROM operations"))
        file.close()
        return start(*args, **kwargs)  # pyright: ignore[reportArgumentType]

    bench.service.network.node(1).axis(0).move_to = look_first  # pyright: ignore[reportAttributeAccessIssue]
    assert (await bench.move(100, wait=20)).json()["state"] == "succeeded"
    assert seen == [(1, "queued")]


async def test_a_refused_command_leaves_no_operation_behind(bench: Bench) -> None:
    assert (await bench.move(100, axis="1")).status_code == 409
    assert (await bench.get("/operations")).json()["operations"] == []


async def test_what_ran_when_the_service_died_has_failed_and_says_what_was_found(path: Path) -> None:
    async with running(configuration(path)) as bench:
        await bench.until_ready()
        await bench.enable()
        operation = (await bench.move(900_000)).json()
        await bench.until_moving()
        rows = await bench.service.store.rows("SELECT document, key FROM operations")
        # The end of this service is a clean one; what a killed one would have left is put in its place.
    async with running(configuration(path)) as bench:
        await bench.service.store.commit(
            Statement("UPDATE operations SET state = 'running', ended = NULL, document = ?", (rows[0][0],))
        )
    async with running(configuration(path)) as bench:
        assert bench.service.finder is not None
        await bench.service.finder
        told = (await bench.get(f"/operations/{operation['id']}")).json()
        assert told["state"] == "failed"
        assert told["error"]["code"] == "service_restarted"
        assert told["ended"] is not None
        (found,) = told["evidence"]["found"]
        assert (found["node"], found["axis"], found["moving"]) == (1, 0, False)
        assert found["position"]["steps"] == (await bench.axis())["position"]["steps"]


RELATIVE = {"target": 1000, "relative": True, "unit": "steps"}


async def test_a_key_is_heeded_after_a_restart(path: Path) -> None:
    key = {"Idempotency-Key": "k"}
    async with running(configuration(path)) as bench:
        await bench.until_ready()
        await bench.enable()
        first = await bench.post("/nodes/1/axes/0/move?wait=20", RELATIVE, headers=key)
        assert first.json()["state"] == "succeeded"
    async with running(configuration(path)) as bench:
        await bench.until_ready()
        await bench.enable()
        again = await bench.post("/nodes/1/axes/0/move?wait=20", RELATIVE, headers=key)
        assert (again.status_code, again.json()) == (200, first.json())
        assert again.headers["idempotent-replayed"] == "true"
        assert len((await bench.get("/operations")).json()["operations"]) == 1
        other = await bench.post("/nodes/1/axes/0/move", RELATIVE | {"target": 1}, headers=key)
        assert other.json()["code"] == "key_reused"
        await bench.service.store.commit(Statement("DROP TABLE keys"))
        unreadable = await bench.post("/nodes/1/axes/0/move", RELATIVE, headers={"Idempotency-Key": "new"})
        assert unreadable.status_code == 202, "a broken store stops no new command"


async def test_a_key_in_flight_at_the_end_is_answered_with_its_operation(bench: Bench, path: Path) -> None:
    key = {"Idempotency-Key": "k"}
    operation = (await bench.post("/nodes/1/axes/0/move", RELATIVE, headers=key)).json()
    await bench.service.store.commit(Statement("UPDATE keys SET status = NULL, headers = NULL, body = NULL"))
    with sqlite3.connect(path) as old, sqlite3.connect(path.with_name("copy.db")) as copy:
        old.backup(copy)
    old.close()
    copy.close()
    async with running(configuration(path.with_name("copy.db"))) as following:
        again = await following.post("/nodes/1/axes/0/move", RELATIVE, headers=key)
        assert again.headers["idempotent-replayed"] == "true"
        assert again.headers["location"] == f"/api/v1/operations/{operation['id']}"
        assert again.status_code == 200
        assert again.json()["id"] == operation["id"]
        assert again.json()["state"] in ("failed", "succeeded")


async def test_a_key_is_written_down_with_its_operation_or_before_the_command(bench: Bench) -> None:
    seen: list[list[tuple[object, ...]]] = []
    commit = bench.service.store.commit

    async def watch(*statements: Statement) -> bool:
        done = await commit(*statements)
        seen.append([(s.sql.split()[4], s.values[0] if "keys" in s.sql else s.values[4]) for s in statements])
        return done

    bench.service.store.commit = watch
    await bench.post("/nodes/1/axes/0/move", RELATIVE, headers={"Idempotency-Key": "moves"})
    await bench.post("/nodes/1/axes/1/enable", headers={"Idempotency-Key": "enables"})
    moves, enables = "anonymous:moves", "anonymous:enables"
    assert seen == [[("keys", moves), ("operations", moves)], [("keys", enables)]]


async def test_pages_go_back_in_time_and_states_can_be_chosen(bench: Bench) -> None:
    ids = [(await bench.move(target, wait=20)).json()["id"] for target in (100, 200, 300)]
    first = (await bench.get("/operations?limit=2")).json()["operations"]
    assert [o["id"] for o in first] == [ids[2], ids[1]]
    second = (await bench.get(f"/operations?limit=2&before={ids[1]}")).json()["operations"]
    assert [o["id"] for o in second] == [ids[0]]
    assert (await bench.get("/operations?state=failed")).json()["operations"] == []
    assert (await bench.get("/operations?before=nobody")).status_code == 404


async def test_a_broken_store_stops_no_motor_and_says_that_history_is_off(bench: Bench) -> None:
    await bench.service.store.rows("PRAGMA max_page_count = 1")
    await bench.service.store.rows("PRAGMA wal_checkpoint(TRUNCATE)")
    filler = Statement(
        "INSERT INTO keys (key, born, fingerprint) VALUES ('filler', 0, ?)", (b"x" * 10_000_000,)
    )
    assert not await bench.service.store.commit(filler)
    operation = (await bench.move(2000, wait=20)).json()
    assert operation["state"] == "succeeded"
    assert (await bench.axis())["position"]["steps"] == 2000
    assert (await bench.get(f"/operations/{operation['id']}")).json()["state"] == "succeeded"
    assert [o["id"] for o in (await bench.get("/operations")).json()["operations"]] == [operation["id"]]
    ready = await bench.client.get("/readyz")
    assert ready.status_code == 200
    assert "History is off" in ready.json()["warnings"][0]
    assert (await bench.get("/operations/0123")).status_code == 503
    assert (await bench.post("/stop")).status_code == 200


async def test_what_the_store_missed_is_written_when_it_is_back(bench: Bench, tmp_path: Path) -> None:
    folder = tmp_path / "not yet"
    folder.write_text("a file where a folder should be")
    store = Database(folder / "canaxis.db", retry=0.01)
    async with AsyncExitStack() as end:
        await store.open()
        end.push_async_callback(store.close)
        missing, back = OperationRegister(store, bench.service.network.axis), asyncio.Event()
        store.on_return.append(back.set)
        axis = bench.service.network.node(1).axis(0)
        motions = [never_begun(axis) for _ in range(2)]
        for motion in motions:
            missing.add(motion, {"target": 0})
        motions[0].give_up("It was not wanted.")
        folder.unlink()
        await asyncio.wait_for(back.wait(), 10)
        found = [
            await OperationRegister(store, bench.service.network.axis).get(motion.id) for motion in motions
        ]
    assert [operation.state.value for operation in found] == ["cancelled", "queued"]
    assert found[0] == missing.reply_for(motions[0])


async def test_old_ones_are_pruned_by_age_and_by_number(path: Path) -> None:
    async with running(configuration(path, keep_operations=3, keep_days=1)) as bench:
        await bench.until_ready()
        await bench.enable()
        ids = [(await bench.move(100 * n, wait=20)).json()["id"] for n in range(1, 6)]
        bench.service.operations.prune()
        kept = await bench.service.store.rows("SELECT id FROM operations ORDER BY created")
        assert [row[0] for row in kept] == ids[2:]
        await bench.service.store.commit(
            Statement("UPDATE operations SET ended = ended - 90000 WHERE id = ?", (ids[3],))
        )
        bench.service.operations.prune()
        kept = await bench.service.store.rows("SELECT id FROM operations ORDER BY created")
        assert [row[0] for row in kept] == [ids[2], ids[4]]


async def test_fencing_tokens_rise_over_restarts_even_if_the_clock_goes_back(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fencing: list[int] = []
    token = "of nobody"
    for wall in (2e9, 1.9e9):
        monkeypatch.setattr("app.leases.leases.time", SimpleNamespace(time=lambda wall=wall: wall))
        async with running(configuration(path)) as bench:
            await bench.until_ready()
            old = await bench.post("/nodes/1/axes/0/enable", headers={"Lease": token})
            assert (old.status_code, old.json()["code"]) == (423, "lease_lost")
            for _ in range(2):
                lease = (await bench.post("/leases", {"node": 1, "force": True})).json()
                fencing.append(lease["fencing"])
                token = str(lease["token"])
    assert fencing[0] == 2e12, "so that it rises over restarts without a store too"
    assert fencing == sorted(set(fencing))
