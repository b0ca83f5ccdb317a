"""Plant faults in the files that move motors, one at a time, and print those that no test finds.

`python tests/mutants` tries a sample that ends within ten minutes; `make mutants` is the same with MINUTES=,
SEED=, FILES=, JOBS= and MUTANT=. The work tree is never changed. See docs/testing.md.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from mutant import Mutant, difference, mutants_of
from mutant_changes import KINDS
from mutant_record import Record, Recording
from mutant_report import Accepted, summary, survivor
from mutant_scope import BESIDE, FILES, LEFT_ALONE, MARKED, OTHER_TESTS, chosen
from mutant_trials import Outcome, Trials, Verdict, reaching

HERE = Path(__file__).resolve().parent
RESERVE = 10.0
"""Seconds of the minutes given that are left for ending."""
RECORDING = 0.6
"""Part of the time after which tests that were not looked at yet are left out."""
TOGETHER = 30
"""Test files that are looked at together, and kept."""
FIND = (Verdict.FOUND, Verdict.HUNG, Verdict.DIED)


def main() -> int:
    """Read the command line and try mutants."""
    began = time.monotonic()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # it ends early, as by Ctrl-C
    options = _options()
    root: Path = options.root.resolve()
    os.chdir(root)
    watched = chosen(root, FILES if options.root == HERE.parents[1] else options.files, LEFT_ALONE)
    known = [mutant for file in watched for mutant in mutants_of(root, file)]
    wanted = _wanted(known, options)
    if options.list:
        print(*wanted, sep="\n")
        return 0
    if not wanted:
        print("There is no such mutant.", file=sys.stderr)
        return 2
    ends = began + 60 * options.minutes
    record = _record(
        root, watched, options, ends if options.mutant else ends - (1 - RECORDING) * 60 * options.minutes
    )
    if options.mutant:
        return _one(root, wanted, record, options)
    sample = _sample(wanted, options)
    accepted = Accepted((HERE / "accepted.txt").read_text())
    outcomes = _many(root, sample, record, options, until=ends - RESERVE)
    return _report(root, outcomes, wanted, accepted, options, time.monotonic() - began)


def _options() -> argparse.Namespace:
    kinds = "\n".join(f"  {kind:9} {meaning}" for kind, meaning in KINDS.items())
    parser = argparse.ArgumentParser(
        prog="tests/mutants",
        description=__doc__,
        epilog=f"Kinds of faults:\n{kinds}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--minutes", type=float, default=10, help="end within so long (default: 10)")
    parser.add_argument("--sample", type=int, help="try at most so many (default: as time allows)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default: 0)")
    parser.add_argument(
        "--files", nargs="+", metavar="PATTERN", help="only of these files, as 'app/jog/**.py'"
    )
    parser.add_argument("--kinds", nargs="+", choices=KINDS, metavar="KIND", help="only of these kinds")
    parser.add_argument(
        "--mutant", nargs="+", metavar="FILE:LINE:KIND", help="try these, with all their tests"
    )
    parser.add_argument("--list", action="store_true", help="only name the mutants")
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time (default: 2)")
    parser.add_argument(
        "--patience", type=float, default=10, help="seconds of tests for one mutant (default: 10)"
    )
    parser.add_argument(
        "--slack", type=float, default=5, help="seconds that a test may take in any case (default: 5)"
    )
    parser.add_argument("--record", action="store_true", help="record anew which test reaches what")
    parser.add_argument(
        "--fail-under", type=float, default=0, metavar="PERCENT", help="exit 1 if fewer are found"
    )
    parser.add_argument("--root", type=Path, default=HERE.parents[1], help=argparse.SUPPRESS)
    return parser.parse_args()


def _wanted(known: Sequence[Mutant], options: argparse.Namespace) -> list[Mutant]:
    if options.mutant:
        return [mutant for mutant in known if str(mutant) in options.mutant]
    files = set(chosen(options.root, options.files)) if options.files else None
    return [
        mutant
        for mutant in known
        if (files is None or mutant.file in files) and (not options.kinds or mutant.kind in options.kinds)
    ]


def _sample(wanted: Sequence[Mutant], options: argparse.Namespace) -> list[Mutant]:
    shuffled = sorted(wanted, key=str)
    random.Random(options.seed).shuffle(shuffled)
    return shuffled[: options.sample]


def _record(root: Path, watched: Sequence[str], options: argparse.Namespace, until: float) -> Record:
    """Which test reaches what, as of now, as far as the time allows."""
    kept = root / ".mutants" / "record.json"
    record = Record() if options.record else Record.load(kept)
    beside = chosen(root, BESIDE)
    tests = sorted({*chosen(root, ["tests/**test_*.py"], OTHER_TESTS), *beside})
    marked = {name: MARKED for name in tests if name not in beside}
    recording = Recording(root, watched, tests, marked, options.jobs)
    stale = recording.stale(record)
    while stale and time.monotonic() < until:
        print(f"Looking which test reaches what: {len(stale)} files of {len(tests)} to run ...", flush=True)
        if recording.add(record, stale[:TOGETHER], until - time.monotonic()):
            record.save(kept)
            del stale[:TOGETHER]
    print(f"{len(record.cases())} tests take part.")
    if stale:
        print(f"The tests of {len(stale)} files don't yet, there was no time: run this again, or for longer.")
    for name in record.failed():
        print(f"Takes no part, since it failed or was skipped with nothing planted: {name}")
    return record


def _one(root: Path, wanted: Sequence[Mutant], record: Record, options: argparse.Namespace) -> int:
    """Each with all of its tests, whose words are printed."""
    for mutant in wanted:
        before, after = difference(root, mutant)
        print(f"\n{mutant}: {KINDS[mutant.kind]}\n    - {before}\n    + {after}")
        for test in reaching(mutant, record, record.cases()):
            print(f"    reached by {test}")
    sys.stdout.flush()
    outcomes: list[Outcome] = []
    Trials(root, record, 1, float("inf"), options.slack, told=outcomes.append, output=1).run(wanted)
    for outcome in outcomes:
        by = f", {outcome.tests[-1]}" if outcome.tests and outcome.verdict in FIND else ""
        print(f"\n{outcome.mutant}: {outcome.verdict.value}{by} ({len(outcome.tests)} tests ran)")
    return 0


def _many(
    root: Path, sample: Sequence[Mutant], record: Record, options: argparse.Namespace, until: float
) -> list[Outcome]:
    outcomes: list[Outcome] = []
    began = told = time.monotonic()

    def tell(outcome: Outcome) -> None:
        nonlocal told
        outcomes.append(outcome)
        now = time.monotonic()
        if outcome.verdict not in FIND:
            print(f"{outcome.mutant}: {outcome.verdict.value}", flush=True)
        if now - told > 10:
            told = now
            found = sum(one.verdict in FIND for one in outcomes)
            print(f"{len(outcomes)} tried, {found} found, {now - began:.0f} s", flush=True)

    Trials(root, record, options.jobs, options.patience, options.slack, until, tell).run(sample)
    return outcomes  # also if it was ended early: pytest takes a Ctrl-C for itself


def _report(
    root: Path,
    outcomes: Sequence[Outcome],
    wanted: Sequence[Mutant],
    accepted: Accepted,
    options: argparse.Namespace,
    seconds: float,
) -> int:
    survivors = sorted(
        (outcome for outcome in outcomes if outcome.verdict not in FIND),
        key=lambda outcome: (outcome.verdict.value, outcome.mutant.file, outcome.mutant.line),
    )
    shown = [outcome for outcome in survivors if accepted.reason(root, outcome.mutant) is None]
    for outcome in shown:
        print(f"\n{survivor(root, outcome)}")
    for entry in accepted.stale(root, wanted) if not (options.files or options.kinds) else ():
        print(f"\naccepted.txt: nothing is like this any more: {entry}")
    files = len({mutant.file for mutant in wanted})
    print(f"\n{summary(outcomes, len(survivors) - len(shown), len(wanted), files, seconds)}")
    if shown:
        print(f"One of them alone: make mutants MUTANT={shown[0].mutant}")
    share = 100 * (1 - len(shown) / len(outcomes)) if outcomes else 0
    return 1 if share < options.fail_under else 0


if __name__ == "__main__":
    sys.exit(main())
