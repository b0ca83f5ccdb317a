"""The virtual clock of the tests: time passes only when nothing is left to do."""

from __future__ import annotations

import asyncio

import looptime


def virtual_loop() -> asyncio.AbstractEventLoop:
    """No idle turns before each step of the clock, of which looptime makes 42: most of a test's time."""
    loop = looptime.new_event_loop()
    loop.setup_looptime(noop_cycles=0)
    return loop
