"""Play seeds: one of them to see what it does, or many thousands to find one that fails.

`python tests/seeds --seed 12345` replays one, `python tests/seeds --seeds 10000` plays 0 to 9999; `make soak`
is the same with SEED=, SEEDS=, FROM= and PROCESSES=. The exit code is 1 if an invariant was violated.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time

from seed_run import Outcome, run


def main() -> int:
    """Read the command line and play."""
    parser = argparse.ArgumentParser(prog="tests/seeds", description=__doc__)
    parser.add_argument("--seed", type=int, help="play this one alone")
    parser.add_argument("--seeds", type=int, default=5_000, help="how many to play (default: 5000)")
    parser.add_argument("--from", dest="first", type=int, default=0, help="the first one (default: 0)")
    parser.add_argument("--processes", type=int, default=2, help="how many at a time (default: 2)")
    chosen = parser.parse_args()
    if chosen.seed is not None:
        return _one(chosen.seed)
    return _many(range(chosen.first, chosen.first + chosen.seeds), chosen.processes)


def _one(seed: int) -> int:
    outcome = run(seed)
    if outcome.violation is not None:
        print(outcome)
        return 1
    print(f"seed {seed}: every invariant held for {outcome.seconds:.1f} virtual seconds,", end=" ")
    print(f"{outcome.lines} events, trace {outcome.digest}")
    return 0


def _many(seeds: range, processes: int) -> int:
    failed: list[int] = []
    played, virtual, began, told = 0, 0.0, time.monotonic(), time.monotonic()
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for outcome in pool.imap_unordered(run, seeds, chunksize=4):
            played += 1
            virtual += outcome.seconds
            if outcome.violation is not None:
                failed.append(outcome.seed)
                print(f"seed {outcome.seed}: {_headline(outcome)}", flush=True)
            if time.monotonic() - told > 10 or played == len(seeds):
                told = time.monotonic()
                print(
                    f"{played} of {len(seeds)} seeds, {virtual:.0f} virtual s in {told - began:.0f} s",
                    flush=True,
                )
    for seed in sorted(failed):
        print(f"failed: make soak SEED={seed}")
    return 1 if failed else 0


def _headline(outcome: Outcome) -> str:
    return (outcome.violation or "").splitlines()[0]


if __name__ == "__main__":
    sys.exit(main())
