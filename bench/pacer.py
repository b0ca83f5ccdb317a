"""Sends frames at a steady rate from a process of its own: `python -m bench.pacer FD COUNT RATE`.

The frames come on standard input as `can_frame`s and are sent round and round, `COUNT` in all, one after the
other as a wire brings them, each on an absolute deadline. It prints how many of them the other end had no
room for.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Sequence

from bench.wire import CAN_FRAME


class Pacer:
    """The process. It waits until it is told to `go`; use it as a context manager."""

    def __init__(self, end: socket.socket, frames: Sequence[bytes], count: int, rate: float) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "bench.pacer", str(end.fileno()), str(count), str(rate)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(end.fileno(),),
        )
        self._frames = b"".join(frames)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == b"ready\n"

    def __enter__(self) -> Pacer:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def go(self) -> None:
        """Begin to send."""
        assert self._process.stdin is not None
        self._process.stdin.write(self._frames)
        self._process.stdin.close()

    @property
    def done(self) -> bool:
        """Whether all is sent."""
        return self._process.poll() is not None

    def refused(self) -> int:
        """Wait for the end; how many frames the other end had no room for, which are lost."""
        assert self._process.stdout is not None
        return int(self._process.stdout.readline())


def _send(end: socket.socket, frames: Sequence[bytes], count: int, rate: float) -> int:
    """Send `count` frames; how many of them found no room."""
    refused = 0
    began = time.monotonic()
    for number in range(count):
        ahead = began + number / rate - time.monotonic()
        if ahead > 0:
            time.sleep(ahead)
        try:
            end.send(frames[number % len(frames)])
        except BlockingIOError:
            refused += 1
    return refused


def _main() -> None:
    descriptor, count, rate = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    print("ready", flush=True)
    raw = sys.stdin.buffer.read()
    frames = [raw[start : start + CAN_FRAME.size] for start in range(0, len(raw), CAN_FRAME.size)]
    with socket.socket(fileno=descriptor) as end:
        print(_send(end, frames, count, rate), flush=True)


if __name__ == "__main__":
    _main()
