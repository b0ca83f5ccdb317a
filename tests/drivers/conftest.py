"""What the tests of the whole stack share: see `stack_kit`."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
from stack_kit import Stack, stack_of


@pytest.fixture
async def stack() -> AsyncIterator[Stack]:
    """One module with three axes, and the master; operational."""
    async with stack_of(1) as one:
        await one.ready()
        yield one
