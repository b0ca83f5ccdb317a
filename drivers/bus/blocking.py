"""Calls that block, kept away from the event loop and from its end."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


async def in_thread(work: Callable[[], T], abandon: Callable[[T], object]) -> T:
    """Run `work` in a daemon thread and return what it returns, or raise what it raises.

    If the caller is cancelled or timed out meanwhile, `work` goes on alone, and its late result is given to
    `abandon`, still in that thread. Unlike `asyncio.to_thread`, a call that never comes back holds up neither
    the loop's closing nor the program's end.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()
    given_up = threading.Event()

    def settle(result: T) -> None:
        if future.done():
            threading.Thread(target=abandon, args=(result,), daemon=True).start()
        else:
            future.set_result(result)

    def fail(error: Exception) -> None:
        if not future.done():
            future.set_exception(error)

    def run() -> None:
        try:
            result = work()
        except Exception as error:
            if not given_up.is_set():
                _call(loop, fail, error)
            return
        if given_up.is_set() or not _call(loop, settle, result):
            abandon(result)

    threading.Thread(target=run, name="blocking call", daemon=True).start()
    try:
        return await future
    finally:
        given_up.set()


A = TypeVar("A")


def _call(loop: asyncio.AbstractEventLoop, callback: Callable[[A], None], argument: A) -> bool:
    """Call back in the loop; False if it is closed."""
    try:
        loop.call_soon_threadsafe(callback, argument)
    except RuntimeError:
        return False
    return True
