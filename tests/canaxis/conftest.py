"""The service in this process, as tests/app has it."""

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
