"""`canaxis` with one thing more: SIGUSR1 blocks its event loop, as a bug could; its other threads run on.

The first argument says for how many seconds; the rest is the command line.
"""

from __future__ import annotations

import signal
import sys
import time

from app.cli import main

if __name__ == "__main__":
    seconds = float(sys.argv.pop(1))
    # Python runs a signal's handler in the main thread, which is where the event loop is.
    signal.signal(signal.SIGUSR1, lambda *_: time.sleep(seconds))
    main()
