"""What a service leaves that failed at its start, or was hurried at its end: nothing."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from api_bench import running
from fastapi import FastAPI

from app.configuration.configuration import AuditConfiguration, Configuration, StoreConfiguration
from app.idempotency.keys import Keys
from app.main import create_app
from app.store.database import Database
from drivers.bus.memory import MemoryWire
from drivers.master.network import Network


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    return Configuration(
        store=StoreConfiguration(file=tmp_path / "canaxis.db"),
        audit=AuditConfiguration(file=tmp_path / "audit.jsonl"),
    )


@pytest.fixture
def app(configuration: Configuration) -> FastAPI:
    return create_app(configuration, MemoryWire(bit_rate=1_000_000).port("master"))


async def is_free(configuration: Configuration) -> bool:
    store = Database(configuration.store.file)
    await store.open()
    free = store.health.on
    await store.close()
    return free


@pytest.mark.parametrize(("part", "method"), [(Keys, "open"), (Network, "open")])
async def test_a_start_that_fails_half_way_closes_what_was_opened(
    part: type, method: str, app: FastAPI, configuration: Configuration, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr(part, method, fail)
    with pytest.raises(RuntimeError, match="a bug"):
        async with app.router.lifespan_context(app):
            pytest.fail("it started")
    assert await is_free(configuration)


async def test_so_does_one_that_is_cancelled(
    app: FastAPI, configuration: Configuration, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = asyncio.Event()

    async def hang(*_: object) -> None:
        begun.set()
        await asyncio.Event().wait()

    async def live() -> None:
        async with app.router.lifespan_context(app):
            pytest.fail("it started")

    monkeypatch.setattr(Network, "open", hang)
    living = asyncio.create_task(live())
    await begun.wait()
    living.cancel()
    await asyncio.wait({living})
    assert living.cancelled()
    assert await is_free(configuration)


async def test_an_end_that_is_cancelled_ends_everything_all_the_same(
    configuration: Configuration, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a second signal does, while axes are ramped down."""
    begun = asyncio.Event()

    async def hang() -> None:
        begun.set()
        await asyncio.Event().wait()

    async with running(configuration) as bench:
        with monkeypatch.context() as patch:
            patch.setattr(bench.service.network, "close", hang)
            ending = asyncio.create_task(bench.service.close())
            await begun.wait()
            ending.cancel()
            await asyncio.wait({ending})
        assert ending.cancelled()
        assert bench.service.store.health.reason == "The store is closed."
        assert await is_free(configuration)
        names = {task.get_name() for task in asyncio.all_tasks()}
        assert not names & {"journal", "failure watch", "store"}
