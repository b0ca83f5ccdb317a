"""The blocking client is made from the asynchronous one: what becomes of a source, and which changes show."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

TOOL = Path(__file__).parents[2] / "tools" / "blocking.py"
SOURCE = '''\
"""For an event loop: what an `async with` gives."""

from collections.abc import AsyncGenerator

from canaxis.asynchronous.waiting import sleep


class AsyncThing:
    """An `AsyncThing` may be shared by tasks."""

    async def __aenter__(self) -> "AsyncThing":
        await sleep(1)  # a task
        return self

    async def words(self) -> AsyncGenerator[str]:
        async with self as thing:
            async for word in thing.words():
                yield (await self.said(word)) + "asynchronous"
'''
MADE = '''\
# Made by `make client` from canaxis/asynchronous/thing.py: change that.
"""For plain Python: what a `with` gives."""

from collections.abc import Generator

from canaxis.blocking.waiting import sleep


class Thing:
    """A `Thing` may be shared by threads."""

    def __enter__(self) -> "Thing":
        sleep(1)  # a thread
        return self

    def words(self) -> Generator[str]:
        with self as thing:
            for word in thing.words():
                yield (self.said(word)) + "asynchronous"
'''


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """The tool, on folders of its own."""
    spec = importlib.util.spec_from_file_location("blocking", TOOL)
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    for name in ("SOURCE", "TARGET"):
        folder = tmp_path / name.lower()
        folder.mkdir()
        (folder / "waiting.py").write_text(f"by hand, for {name}")
        monkeypatch.setattr(tool, name, folder)
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    (tool.SOURCE / "thing.py").write_text(SOURCE)
    return tool


def test_what_awaits_blocks_in_code_and_in_words(tool: ModuleType) -> None:
    tool.write()
    assert (tool.TARGET / "thing.py").read_text() == MADE
    assert (tool.TARGET / "waiting.py").read_text() == "by hand, for TARGET"
    assert tool.differences() == ""


def test_every_change_on_either_side_is_a_difference(tool: ModuleType) -> None:
    assert "+class Thing" in tool.differences(), "not made yet"
    tool.write()
    made, source = tool.TARGET / "thing.py", tool.SOURCE / "thing.py"
    made.write_text(MADE.replace("sleep(1)", "sleep(2)"))
    assert "-        sleep(2)" in tool.differences()
    made.write_text(MADE)
    source.write_text(SOURCE.replace("sleep(1)", "sleep(3)"))
    assert "+        sleep(3)" in tool.differences()
    source.unlink()
    assert "-class Thing" in tool.differences(), "its source is gone"
    tool.write()
    assert not made.exists()
