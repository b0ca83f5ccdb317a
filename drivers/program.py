"""A Python process of ours beside this one: how it is started so that it finds our packages, not another's.

`python -m drivers.…` would look in the folder where it is started and in `PYTHONPATH` first, where somebody
else may have a package called `drivers`, or `app`.
"""

from __future__ import annotations

import sys
from pathlib import Path

HOME = str(Path(__file__).resolve().parents[1])
"""The folder that our packages are in."""
_START = """
import runpy, sys
home, module = sys.argv[1:3]
del sys.argv[1:3]
sys.path.insert(0, home)
for name in {"drivers", module.partition(".")[0]}:
    __import__(name)
sys.path.remove(home)
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def command(module: str, *arguments: str) -> tuple[str, ...]:
    """The command that runs `module`, one of ours, as ``python -m`` would, but ours for certain.

    The folder it is started in is not looked into for modules (``-P``); `PYTHONPATH` holds for all but ours.
    """
    return (sys.executable, "-P", "-c", _START, HOME, module, *arguments)
