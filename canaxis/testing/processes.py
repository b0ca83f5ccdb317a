"""`canaxis` as a process of its own that ends with ours."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Final, Self

ENDING: Final = 30.0
"""Seconds that it gets to end by itself: a service ramps its axes down first."""


class NotStarted(RuntimeError):
    """It ended, or said nothing, before it could be used; `str()` has what it printed."""


class CanaxisProcess:
    """``with CanaxisProcess(folder, "simulate", ...) as process:`` runs `canaxis simulate ...` in a folder.

    It gets none of our `CANAXIS_` variables, and is in a session of its own: Ctrl-C comes to us alone. It
    watches its standard input, which we hold: it ends with us even if we are killed.
    """

    def __init__(self, folder: Path, *arguments: str) -> None:
        """Nothing is started yet."""
        self._folder = folder
        self._arguments = (*arguments, "--exit-with-parent")
        self._lines: list[str] = []
        self._ended = False
        self._news = threading.Condition()

    @property
    def output(self) -> str:
        """All that it printed so far, the log included."""
        with self._news:
            return "".join(self._lines)

    def until(self, pattern: str, within: float) -> re.Match[str]:
        """Wait until it printed a line that matches. Raises `NotStarted` if it ends before, or time does."""
        deadline = time.monotonic() + within
        seen = 0
        with self._news:
            while True:
                for line in self._lines[seen:]:
                    if found := re.match(pattern, line):
                        return found
                seen = len(self._lines)
                if self._ended or not self._news.wait(max(0.0, deadline - time.monotonic())):
                    raise NotStarted(self._trouble(within))

    def __enter__(self) -> Self:
        """Start it."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "canaxis_command", *self._arguments],
            cwd=self._folder,
            env={name: value for name, value in os.environ.items() if not name.startswith("CANAXIS_")}
            | {"PYTHONUNBUFFERED": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, name="output of canaxis", daemon=True)
        self._reader.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End it, in an orderly way as long as that takes no more than `ENDING`."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        try:
            process.wait(ENDING)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._reader.join()
        process.stdout.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._news:
                self._lines.append(line)
                self._news.notify_all()
        with self._news:
            self._ended = True
            self._news.notify_all()

    def _trouble(self, within: float) -> str:
        what = "ended" if self._ended else f"was not ready within {within:g} s"
        said = "".join(self._lines).strip()
        return f"canaxis {self._arguments[0]} {what}: {said or 'it printed nothing'}"
