"""A module and the service, each in a process of its own, with a wire between them."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from bench.http_load import Address, check
from bench.machine import ahead_of_the_rest, cores
from bench.wire import pair

ENDING = 20.0
OPERATIONAL = 30.0
"""Seconds that the service gets to bring the module up."""


@contextmanager
def child(module: str, end: socket.socket, *, core: int | None = None) -> Generator[subprocess.Popen[str]]:
    """A module of this package as a process on one core, with one end of a wire; ended at the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", f"bench.{module}", str(end.fileno())],
        pass_fds=[end.fileno()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={k: v for k, v in os.environ.items() if not k.startswith("CANAXIS_")},
    )
    end.close()
    try:
        if core is not None:
            os.sched_setaffinity(process.pid, {core})
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(ENDING)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            pipe.close()


@dataclass(frozen=True, slots=True)
class Module:
    """The module's process."""

    process: subprocess.Popen[str]

    def ask(self, command: str) -> Any:
        """Give it a command and wait for the answer; see `bench.module_process`."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{command}\n")
        self.process.stdin.flush()
        return read_line(self.process)


def read_line(process: subprocess.Popen[str]) -> Any:
    """A line of JSON from a process. Raises `RuntimeError` if it ended instead."""
    pipe: IO[str] | None = process.stdout
    assert pipe is not None
    line = pipe.readline()
    if not line:
        raise RuntimeError(f"a process of the benchmark ended with {process.wait(ENDING)}")
    return json.loads(line)


@dataclass(frozen=True, slots=True)
class Rig:
    """Both, at work."""

    module: Module
    server: subprocess.Popen[str]
    address: Address

    async def get(self, path: str) -> Any:
        """What the service says."""
        return await self._ask("GET", path)

    async def post(self, path: str) -> Any:
        """Have the service do something."""
        return await self._ask("POST", path)

    async def _ask(self, method: str, path: str) -> Any:
        connection = await self.address.connect()
        try:
            return json.loads(check(await connection.send(self.address.request(method, path))))
        finally:
            connection.close()

    async def until_operational(self) -> None:
        """Wait for the module."""
        async with asyncio.timeout(OPERATIONAL):
            while (await self.get("/api/v1/nodes/1"))["state"] != "operational":  # noqa: ASYNC110
                await asyncio.sleep(0.02)

    def cpu_seconds(self) -> float:
        """What the server's threads have used so far, to the nanosecond."""
        tasks = Path(f"/proc/{self.server.pid}/task").iterdir()
        return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9

    def resident_mib(self) -> float:
        """The server's memory now."""
        status = Path(f"/proc/{self.server.pid}/status").read_text()
        return int(status.split("VmRSS:")[1].split()[0]) / 1024


@asynccontextmanager
async def rig() -> AsyncGenerator[Rig]:
    """The server alone on the first core; the module, and this process, on the last."""
    ours, theirs = pair()
    available = cores()
    first, last = (available[0], available[-1]) if len(available) > 1 else (None, None)
    if last is not None:
        os.sched_setaffinity(0, {last})
    try:
        with ahead_of_the_rest(), child("module_process", theirs, core=last) as module:
            read_line(module)
            with child("server_process", ours, core=first) as server:
                assert server.stdout is not None
                url = await asyncio.to_thread(server.stdout.readline)
                if not url:
                    raise RuntimeError(f"the server ended with {server.wait(ENDING)}")
                running = Rig(Module(module), server, Address.of(url.strip()))
                await running.until_operational()
                yield running
    finally:
        if last is not None:
            os.sched_setaffinity(0, available)
