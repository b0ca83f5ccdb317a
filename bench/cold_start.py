"""From the start of `canaxis serve` to an operational module, beside the import of the libraries alone.

The module is there already, in the process of `canaxis simulate`; the service finds it over socketcand. It is
operational when `/readyz` says so. Libraries and service are byte-compiled, as an installer leaves them: one
start of each comes before those that count.
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


NOT_OURS = ("CANAXIS_", "PYTHONDONTWRITEBYTECODE")
"""Variables that would give the service settings, or have it compile its source at every start."""


def environment(folder: str) -> dict[str, str]:
    """Ours, without settings of the service, and with the code that is measured; compiled into `folder`."""
    own = {name: value for name, value in os.environ.items() if not name.startswith(NOT_OURS)}
    return own | {"PYTHONPATH": os.getcwd(), "PYTHONPYCACHEPREFIX": os.path.join(folder, "compiled")}


@contextmanager
def canaxis(folder: str, *arguments: str) -> Generator[subprocess.Popen[str]]:
    """The command in a folder without settings, ended at the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", "app", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment(folder),
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


def imports(folder: str) -> float:
    """Seconds for a process that imports the libraries and ends."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", PEER], check=True, env=environment(folder))
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
        imports(folder)
        start(folder, can_port)
        for _ in range(rounds):
            libraries.append(imports(folder))
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
