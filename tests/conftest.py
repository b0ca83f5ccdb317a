"""What every test gets: checks for tasks and threads left, a virtual clock, hypothesis's profiles."""

from __future__ import annotations

import asyncio
import functools
import inspect
import os
from collections.abc import AsyncIterator, Callable, Mapping

import pytest
from hypothesis import HealthCheck, settings
from virtual_clock import virtual_loop

from drivers.devices.catalog import Catalog

pytest_plugins = ("threads_left",)

settings.register_profile("dev", deadline=None)
settings.register_profile(
    "ci", deadline=None, derandomize=True, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("ci" if os.environ.get("CI") else "dev")

Catalog.load = functools.cache(Catalog.load)  # immutable, and a third of what it takes to make a stack


@pytest.fixture
async def no_task_left_behind() -> AsyncIterator[None]:
    """Fail a test whose event loop still runs a task after all its other fixtures were torn down."""
    before = asyncio.all_tasks()
    yield
    for _ in range(3):  # let what was cancelled or closed in the teardowns come to its end
        await asyncio.sleep(0)
    left = asyncio.all_tasks() - before - {asyncio.current_task()}
    assert not left, f"tasks left behind: {[task.get_coro() for task in left]}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the leak check to every test that runs in an event loop, as its outermost fixture.

    What waits for processes comes first, so that no worker is left with it when all others have ended.
    """
    items.sort(key=lambda item: item.get_closest_marker("process") is None)
    for item in items:
        if isinstance(item, pytest.Function) and inspect.iscoroutinefunction(item.function):
            item.fixturenames.insert(0, "no_task_left_behind")


def pytest_asyncio_loop_factories(item: pytest.Item) -> Mapping[str, Callable[[], asyncio.AbstractEventLoop]]:
    """Run tests marked `looptime` on a virtual clock from their first fixture to their last teardown.

    The plugin alone turns the clock on for the test's body only: timers that a fixture set would then be due
    a lifetime later, or all at once.
    """
    virtual = item.get_closest_marker("looptime") is not None
    return {"virtual": virtual_loop} if virtual else {"real": asyncio.new_event_loop}
