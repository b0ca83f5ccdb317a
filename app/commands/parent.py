"""`--exit-with-parent`: a process that ends when whoever started it is gone, however that came about.

The parent holds the other end of our standard input and never writes. Its end closes that, also when it is
killed.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Annotated, TypeAlias

import typer

ExitWithParent: TypeAlias = Annotated[
    bool, typer.Option(help="End when standard input ends, as it does when the parent process dies.")
]


@contextmanager
def watching_parent(on_end: Callable[[], None]) -> Generator[None]:
    """Have `on_end` called, once, in the running event loop, when standard input ends."""
    loop = asyncio.get_running_loop()
    number = sys.stdin.fileno()

    def on_input() -> None:
        if not os.read(number, 4096):
            loop.remove_reader(number)
            on_end()

    loop.add_reader(number, on_input)
    try:
        yield
    finally:
        loop.remove_reader(number)
