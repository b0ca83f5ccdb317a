"""The command `canaxis` in processes of its own, for the tests that want the real thing."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO

import httpx

STARTING = 30.0
ENDING = 20.0
JSON = {"Content-Type": "application/json"}


@dataclass
class Canaxis:
    """One running `canaxis`; its output goes to a file, so that it can never block on us."""

    process: subprocess.Popen[bytes]
    output: Path

    @property
    def text(self) -> str:
        """All that it printed so far."""
        return self.output.read_text(encoding="utf-8", errors="replace")

    def until(self, pattern: str, within: float = STARTING) -> re.Match[str]:
        """Wait until it printed something that matches; fails if it ends before."""
        deadline = time.monotonic() + within
        while time.monotonic() < deadline:
            ended = self.process.poll() is not None
            if found := re.search(pattern, self.text):
                return found
            assert not ended, f"ended with {self.process.returncode}:\n{self.text}"
            time.sleep(0.02)
        raise AssertionError(f"no {pattern!r} within {within} s in:\n{self.text}")

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    def ended(self, within: float = ENDING) -> int:
        """Wait for its end; the exit code."""
        return self.process.wait(within)


class Running:
    """`with Running(directory, "serve", ...) as canaxis:`; whatever happens, nothing of it stays behind."""

    def __init__(
        self,
        directory: Path,
        *arguments: str,
        stdin: IO[bytes] | int | None = None,
        program: Sequence[str] = ("-m", "app"),
    ) -> None:
        """`program` is what Python runs, should it not be `canaxis` itself but a script around it."""
        self._directory = directory
        self._arguments = arguments
        self._program = program
        self._stdin = subprocess.DEVNULL if stdin is None else stdin
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Canaxis:
        output = self._directory / f"{self._arguments[0]}-{time.monotonic_ns()}.out"
        with output.open("wb") as file:
            self._process = subprocess.Popen(
                [sys.executable, *self._program, *self._arguments],
                stdin=self._stdin,
                stdout=file,
                stderr=subprocess.STDOUT,
                cwd=self._directory,
                env={k: v for k, v in os.environ.items() if not k.startswith("CANAXIS_")}
                | {"XDG_STATE_HOME": str(self._directory)},
                start_new_session=True,
            )
        return Canaxis(self._process, output)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process is not None
        for stop in (self._process.terminate, self._process.kill):
            if self._process.poll() is None:
                stop()
                try:
                    self._process.wait(ENDING)
                except subprocess.TimeoutExpired:
                    continue
        if self._process.stdin is not None:
            self._process.stdin.close()


@contextmanager
def simulator_and_service(directory: Path) -> Iterator[tuple[int, Canaxis, httpx.Client]]:
    """`canaxis simulate` and `canaxis serve` on it: the simulator's port, the service, and a client of it.

    A machine that is short of time must not look like a lost module here: what that gives is tested on a
    virtual clock. So both sides wait long for each other's heartbeat, unless the directory has settings.
    """
    settings = directory / "canaxis.yaml"
    if not settings.exists():
        settings.write_text("network: {consumer_ms: 10000, node_heartbeat_ms: 3000}\n")
    with Running(directory, "simulate", "--port", "0") as simulator:
        can_port = int(simulator.until(r"listens on 127\.0\.0\.1:(\d+)")[1])
        with (
            Running(directory, "serve", "--option", f"port={can_port}", "--port", "0") as service,
            httpx.Client(base_url=service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1], timeout=60) as http,
        ):
            until_ready(http)
            yield can_port, service, http


def until_ready(http: httpx.Client, within: float = STARTING) -> None:
    """Wait until the service can command its modules."""
    deadline = time.monotonic() + within
    while (ready := http.get("/readyz")).status_code != 200:
        assert time.monotonic() < deadline, ready.text
        time.sleep(0.05)
