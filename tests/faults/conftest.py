"""The faults are provoked where a user has them: a service, a client, and a module that can be hurt."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
from api_bench import Bench, running


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    """A service whose one module is operational."""
    async with running() as bench:
        await bench.until_ready()
        yield bench
