"""The command `canaxis`, with the service or without: it finds our packages, or says what is missing.

It stands beside the client, which may know nothing of the service, and imports neither before it must:
`canaxis serve` would take a fifth longer to start with the client and httpx in it.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

OURS = ("app", "drivers")
"""Names that somebody else's packages may well have too."""
HOME = str(Path(__file__).resolve().parents[1])
"""The folder that ours are in."""


def main() -> None:
    """Run it. Without the extra `server`, all but ``--version`` ends with 2, saying what to install."""
    if sys.argv[1:] == ["--version"]:
        print(f"canaxis {_version()}")
        return
    claim()
    try:
        # By name: this package is there without what `app` needs, and may turn to it only after `claim`.
        import_module("app.cli").main()
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in OURS or not missing:
            raise
        print(
            f"canaxis: the service is not installed (there is no {missing}); pip install 'canaxis[server]'",
            file=sys.stderr,
        )
        sys.exit(2)


def claim() -> None:
    """Have `app` and `drivers` mean ours in this process, whatever `PYTHONPATH` and the folder hold.

    Both are imported once, from our own folder; everything in them is then found from there. No other name
    is looked for differently, so that what somebody put into `PYTHONPATH` on purpose is still found.
    """
    sys.path.insert(0, HOME)
    try:
        for name in OURS:
            import_module(name)
    finally:
        sys.path.remove(HOME)


def _version() -> str:
    from importlib.metadata import version  # only here: it takes its time

    return version("canaxis")
