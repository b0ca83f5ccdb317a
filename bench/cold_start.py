"""From the start of `canaxis serve` to an operational module, beside the import of the libraries alone.

The module is there already, in the process of `canaxis simulate`; the service finds it over socketcand. It is
operational when `/readyz` says so.
"""

from __future__ import annotations

import http.client
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager

from bench.machine import ahead_of_the_rest
from bench.parts import main
from bench.report import Goal, Row

PEER = "import fastapi, uvicorn, can, canopen"
POLL = 0.005
"""Seconds between two looks."""
LONGEST = 60.0


def environment() -> dict[str, str]:
    """Ours, without settings of the service, and with the code that is measured."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("CANAXIS_")}
    return own | {"PYTHONPATH": os.getcwd()}


@contextmanager
def canaxis(folder: str, *arguments: str) -> Generator[subprocess.Popen[str]]:
    """The command in a folder without settings, ended at the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", "app", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment(),
    )
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=LONGEST)


def announced(process: subprocess.Popen[str], pattern: str) -> int:
    """The port that a process says it listens on."""
    assert process.stdout is not None
    for line in process.stdout:
        if found := re.search(pattern, line):
            return int(found[1])
    raise RuntimeError(f"the process ended with {process.wait(LONGEST)}")


def until_ready(port: int) -> None:
    """Wait for a 200."""
    end = time.monotonic() + LONGEST
    while time.monotonic() < end:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=LONGEST)
        connection.request("GET", "/readyz")
        status = connection.getresponse().status
        connection.close()
        if status == 200:
            return
        time.sleep(POLL)
    raise TimeoutError("the module did not become operational")


def start(folder: str, can_port: int) -> tuple[float, float]:
    """Seconds to the listening service, and to the operational module."""
    began = time.perf_counter()
    with canaxis(folder, "serve", "--option", f"port={can_port}", "--port", "0") as service:
        port = announced(service, r"listens on http://127\.0\.0\.1:(\d+)")
        listening = time.perf_counter() - began
        until_ready(port)
        return listening, time.perf_counter() - began


def imports() -> float:
    """Seconds for a process that imports the libraries and ends."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", PEER], check=True)
    return time.perf_counter() - began


def run(rounds: int, seconds: float) -> list[Row]:
    """See `bench.parts.Part`; a start takes what it takes."""
    del seconds
    listening: list[float] = []
    operational: list[float] = []
    libraries: list[float] = []
    with (
        ahead_of_the_rest(),
        tempfile.TemporaryDirectory() as folder,
        canaxis(folder, "simulate", "--port", "0") as simulator,
    ):
        can_port = announced(simulator, r"module listens on 127\.0\.0\.1:(\d+)")
        for _ in range(rounds):
            libraries.append(imports())
            to_listen, to_operate = start(folder, can_port)
            listening.append(to_listen)
            operational.append(to_operate)
    against = "python -c 'import fastapi, uvicorn, can, canopen'"
    return [
        Row.beside("cold start to listening", "s", listening, libraries, against),
        Row.beside("cold start to an operational module", "s", operational, libraries, against, Goal(2)),
    ]


if __name__ == "__main__":
    sys.exit(main(("cold_start",)))
