"""Give random commands, kill the service meanwhile, and judge: `python tests/judge --commands 10000`.

The exit code is 1 if anything is not as it must be.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "kits"))

from judge_run import run


def main() -> int:
    """Read the command line, run, and tell."""
    parser = argparse.ArgumentParser(prog="tests/judge", description=__doc__)
    parser.add_argument("--commands", type=int, default=10_000, help="how many in all (default: 10000)")
    parser.add_argument("--clients", type=int, default=4, help="clients at a time (default: 4)")
    parser.add_argument("--restarts", type=int, default=3, help="SIGKILLs of the service (default: 3)")
    parser.add_argument("--seed", type=int, default=0, help="of what the clients choose (default: 0)")
    chosen = parser.parse_args()
    logging.getLogger("can").setLevel(logging.ERROR)  # it tells of each message that comes in two pieces
    with tempfile.TemporaryDirectory() as directory:
        verdict = run(
            Path(directory),
            chosen.commands,
            clients=chosen.clients,
            restarts=chosen.restarts,
            seed=chosen.seed,
        )
    for what, count in sorted(verdict.counts.items()):
        print(f"{count:7} {what}")
    print(f"{verdict.commands} commands that take time, {verdict.seconds:.0f} s")
    print("\n".join(verdict.complaints[:50]) or "each exactly once, each ended, none lost")
    return 1 if verdict.complaints else 0


if __name__ == "__main__":
    sys.exit(main())
