"""The parts of the benchmark, and how a part is run from the command line."""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from collections.abc import Sequence
from typing import Protocol, cast

from bench import machine
from bench.report import Row, table

PARTS = ("receive", "sdo", "service", "trajectory", "cold_start", "simulated_modules")
"""Modules of this package, in the order in which they are run."""
ROUNDS = 5
SECONDS = 2.0


class Part(Protocol):
    """What a module of `PARTS` has."""

    def run(self, rounds: int, seconds: float) -> Sequence[Row]:
        """Measure `rounds` times, each figure for about `seconds`, ours and the peers' in turn."""
        ...


def part(name: str) -> Part:
    """A part by its name; imported only now, because peers take memory and threads."""
    return cast("Part", importlib.import_module(f"bench.{name}"))


def main(names: Sequence[str] = PARTS) -> int:
    """Run the parts that the command line chooses of `names`, and print their rows as they come.

    Returns 0 whether goals are met or not: a timing is no test.
    """
    parser = argparse.ArgumentParser(description="Measure Canaxis beside its peers.")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"how often ({ROUNDS})")
    parser.add_argument("--seconds", type=float, default=SECONDS, help=f"of one measurement ({SECONDS:g})")
    parser.add_argument("--only", choices=names, action="append", help="one part; may be repeated")
    arguments = parser.parse_args()
    rows: list[Row] = []
    for name in arguments.only or names:
        began = time.monotonic()
        rows += part(name).run(arguments.rounds, arguments.seconds)
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr)
    print(f"{machine.description()}; {arguments.rounds} rounds of {arguments.seconds:g} s")
    print("Each figure: minimum / median / maximum over the rounds.\n")
    print(table(rows))
    return 0
