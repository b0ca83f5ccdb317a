"""What the trials of a sample came to, for people."""

from __future__ import annotations

import os.path
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from mutant import Mutant, difference
from mutant_trials import Outcome, Verdict

WIDTH = 100
"""Of a changed line, in characters."""


class Accepted:
    """Mutants that may survive: lines of `FILE KIND: LINE BEFORE`, each with its reason, indented, below."""

    def __init__(self, text: str) -> None:
        self._reasons: dict[str, str] = {}
        self._used: set[str] = set()
        entry = ""
        for line in text.splitlines():
            if line[:1] not in ("", " ", "#"):
                entry = line.strip()
                self._reasons[entry] = ""
            elif line[:1] == " ":
                self._reasons[entry] = f"{self._reasons[entry]} {line.strip()}".strip()

    def reason(self, root: Path, mutant: Mutant) -> str | None:
        """Why this one may survive; None if nobody said so."""
        entry = f"{mutant.file} {mutant.kind}: {difference(root, mutant)[0]}"
        if entry in self._reasons:
            self._used.add(entry)
        return self._reasons.get(entry)

    def stale(self, root: Path, mutants: Iterable[Mutant]) -> list[str]:
        """Entries of files that no mutant fits any more."""
        files = {entry.partition(" ")[0] for entry in self._reasons}
        known = {
            f"{mutant.file} {mutant.kind}: {difference(root, mutant)[0]}"
            for mutant in mutants
            if mutant.file in files
        }
        return [entry for entry in self._reasons if entry not in known]


def survivor(root: Path, outcome: Outcome) -> str:
    """One that no test found: where, what was planted, which tests ran."""
    before, after = shortened(*difference(root, outcome.mutant))
    ran, reaching = len(outcome.tests), outcome.reaching
    if outcome.verdict is Verdict.UNREACHED:
        tests = "no test reaches it"
    elif outcome.verdict is Verdict.UNTRIED:
        tests = "the process ended before any test began: a fault of this tool"
    else:
        of = "" if ran == reaching else f" of the {reaching} that reach it"
        files = Counter(name.partition("::")[0] for name in outcome.tests)
        tests = f"{_tests(ran)}{of} ran: " + ", ".join(_files(files))
    return f"{outcome.mutant}\n    - {before}\n    + {after}\n    {tests}"


def _files(counts: Counter[str], most: int = 6) -> Iterator[str]:
    for file, count in counts.most_common(most):
        yield f"{os.path.basename(file)} {count}"
    if len(counts) > most:
        yield f"{len(counts) - most} more files"


def _tests(number: int) -> str:
    return "1 test" if number == 1 else f"{number} tests"


def shortened(before: str, after: str) -> tuple[str, str]:
    """Both lines around the place where they differ."""
    if max(len(before), len(after)) <= WIDTH:
        return before, after
    same = next((i for i, (a, b) in enumerate(zip(before, after, strict=False)) if a != b), 0)
    cut = max(0, same - WIDTH // 2)
    return _piece(before, cut), _piece(after, cut)


def _piece(line: str, cut: int) -> str:
    head = "... " if cut else ""
    return head + line[cut : cut + WIDTH] + (" ..." if len(line) > cut + WIDTH else "")


def summary(outcomes: Sequence[Outcome], accepted: int, known: int, files: int, seconds: float) -> str:
    """Counts, and how large the sample was."""
    by = Counter(outcome.verdict for outcome in outcomes)
    by_time = by[Verdict.HUNG] + by[Verdict.DIED]
    found = by[Verdict.FOUND] + by_time
    share = f" ({100 * found / len(outcomes):.0f} %)" if outcomes else ""
    kept = f"; {accepted} of them accepted" if accepted else ""
    untried = f"; {by[Verdict.UNTRIED]} could not be tried" if by[Verdict.UNTRIED] else ""
    return (
        f"{len(outcomes)} of {known} mutants of {files} files were tried in {seconds:.0f} s: "
        f"{found} found{share}, of these {by_time} by a hang or a crash; "
        f"{by[Verdict.SURVIVED]} survived; {by[Verdict.UNREACHED]} reached by no test{kept}{untried}."
    )
