"""What a benchmark says: rows of figures over several rounds, and the table of them."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True, slots=True)
class Spread:
    """A figure over the rounds of one run."""

    minimum: float
    median: float
    maximum: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Self:
        """The spread of at least one value."""
        return cls(min(values), statistics.median(values), max(values))

    def __str__(self) -> str:
        return f"{_short(self.minimum)} / {_short(self.median)} / {_short(self.maximum)}"


@dataclass(frozen=True, slots=True)
class Goal:
    """What a row's figure should be: its ratio where it has a peer, else ours. The median counts."""

    limit: float
    at_least: bool = False
    """Whether more is better."""

    def met_by(self, spread: Spread) -> bool:
        """Whether the median is on the right side."""
        return spread.median >= self.limit if self.at_least else spread.median <= self.limit

    def __str__(self) -> str:
        return f"{'>=' if self.at_least else '<='} {self.limit:g}"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    what: str
    unit: str
    """Of `ours` and `peer`; a ratio has none."""
    ours: Spread
    peer: Spread | None = None
    against: str = ""
    """Who the peer is."""
    ratio: Spread | None = None
    """Ours over the peer's, round by round, so that what disturbed a round disturbed both."""
    goal: Goal | None = None
    """None: told for its own sake."""

    @classmethod
    def alone(cls, what: str, unit: str, ours: Sequence[float], goal: Goal | None = None) -> Self:
        """A figure without a peer; a value for each round."""
        return cls(what, unit, Spread.of(ours), goal=goal)

    @classmethod
    def beside(
        cls,
        what: str,
        unit: str,
        ours: Sequence[float],
        peer: Sequence[float],
        against: str,
        goal: Goal | None = None,
    ) -> Self:
        """Ours and a peer's figure from the same rounds, in the same order."""
        ratios = [mine / theirs for mine, theirs in zip(ours, peer, strict=True)]
        return cls(what, unit, Spread.of(ours), Spread.of(peer), against, Spread.of(ratios), goal)

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None where there is none."""
        return None if self.goal is None else self.goal.met_by(self.ratio or self.ours)


HEADINGS = ("what", "unit", "ours", "peer", "against", "ratio", "goal", "met")


def table(rows: Sequence[Row]) -> str:
    """The rows as a Markdown table; every figure is minimum / median / maximum over the rounds."""
    cells = [HEADINGS, *(_cells(row) for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(HEADINGS))]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        row.what,
        row.unit,
        str(row.ours),
        "" if row.peer is None else str(row.peer),
        row.against,
        "" if row.ratio is None else str(row.ratio),
        "" if row.goal is None else str(row.goal),
        {True: "yes", False: "NO", None: ""}[row.met],
    )


def _short(value: float) -> str:
    """Three significant digits, or all digits of what has more before the point."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
