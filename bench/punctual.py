"""A bare loop on absolute deadlines, which is all that a sender of set points can hope for.

    python -m bench.punctual PERIOD SECONDS

It sleeps by `clock_nanosleep` until each deadline and notes how late it woke; with real-time priority where
that is granted, as our sender. It prints the delays as JSON, in milliseconds.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import sys
import time
from collections.abc import Callable

from drivers.cyclic.child import PRIORITY

_CLOCK_MONOTONIC, _TIMER_ABSTIME = 1, 1


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def keep_time(period: float, note: Callable[[float], object], going: Callable[[float], bool]) -> None:
    """Wake each period (seconds) as long as `going` says so of the time; `note` is told each delay in ms."""
    nanosleep = ctypes.CDLL(None, use_errno=True).clock_nanosleep
    due = time.monotonic_ns() + round(period * 1e9)
    while going(due / 1e9):
        until = _Timespec(due // 1_000_000_000, due % 1_000_000_000)
        nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(until), None)
        note((time.monotonic_ns() - due) / 1e6)
        due += round(period * 1e9)
        due = max(due, time.monotonic_ns())  # as ours: what is lost is not made good


def _main() -> None:
    period, seconds = float(sys.argv[1]), float(sys.argv[2])
    gc.disable()
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    delays: list[float] = []
    end = time.monotonic() + seconds
    keep_time(period, delays.append, lambda now: now < end)
    print(json.dumps(delays))


if __name__ == "__main__":
    _main()
