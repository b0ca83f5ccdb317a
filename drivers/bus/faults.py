"""What can happen to a frame on its way: a small set of rules that a test or the fault panel switches on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.bus.frame import Frame
from drivers.errors import BadValue

Predicate = Callable[[Frame], bool]
Outcome = tuple[float, Frame]
"""Seconds until the frame arrives (0: at once), and the frame as it arrives."""


def every(_frame: Frame) -> bool:
    """The predicate that every frame meets."""
    return True


def cob_id(*cob_ids: int) -> Predicate:
    """The predicate that frames with one of these identifiers meet."""
    return lambda frame: frame.cob_id in cob_ids


@dataclass(slots=True, eq=False)
class Fault:
    """One rule. `hits` counts the frames that it struck; `remaining` None means without end."""

    predicate: Predicate
    change: Callable[[Frame], tuple[Outcome, ...]]
    remaining: int | None = None
    hits: int = 0

    def strikes(self, frame: Frame) -> bool:
        """Whether this rule takes the frame; it counts one if so."""
        if self.remaining == 0 or not self.predicate(frame):
            return False
        self.hits += 1
        if self.remaining is not None:
            self.remaining -= 1
        return True

    def end(self) -> None:
        """Strike no more."""
        self.remaining = 0


class Faults:
    """The rules of one wire, applied one after the other, in the order in which they were switched on.

    Each takes a predicate (which frames) and a `count` (how many of them; None: all from now on), and returns
    its `Fault`, to look at `hits` or to `end()` it.
    """

    def __init__(self) -> None:
        self._rules: list[Fault] = []

    def drop(self, predicate: Predicate = every, count: int | None = None) -> Fault:
        """Lose frames."""
        return self._add(Fault(predicate, lambda _frame: (), count))

    def delay(self, predicate: Predicate, seconds: float, count: int | None = None) -> Fault:
        """Let frames arrive `seconds` (> 0) later; others overtake them."""
        if not seconds > 0:
            raise BadValue(f"a delay of {seconds} s is none")
        return self._add(Fault(predicate, lambda frame: ((seconds, frame),), count))

    def duplicate(self, predicate: Predicate = every, count: int | None = None) -> Fault:
        """Let frames arrive twice, one right after the other."""
        return self._add(Fault(predicate, lambda frame: ((0.0, frame), (0.0, frame)), count))

    def corrupt(
        self, change: Callable[[Frame], Frame], predicate: Predicate = every, count: int | None = None
    ) -> Fault:
        """Let frames arrive as `change` makes them."""
        return self._add(Fault(predicate, lambda frame: ((0.0, change(frame)),), count))

    def reorder(self, predicate: Predicate = every, count: int | None = None) -> Fault:
        """Swap each pair of frames that meet the predicate: the first waits for the second."""
        waiting: list[Frame] = []

        def swap(frame: Frame) -> tuple[Outcome, ...]:
            waiting.append(frame)
            if len(waiting) < 2:
                return ()
            swapped = tuple((0.0, late) for late in reversed(waiting))
            waiting.clear()
            return swapped

        return self._add(Fault(predicate, swap, count))

    def clear(self) -> None:
        """Switch everything off."""
        for rule in self._rules:
            rule.end()
        self._rules.clear()

    def apply(self, frame: Frame) -> list[Outcome]:
        """What becomes of a frame: none, one or more arrivals."""
        outcomes: list[Outcome] = [(0.0, frame)]
        for rule in self._rules:
            changed: list[Outcome] = []
            for waited, passing in outcomes:
                if rule.strikes(passing):
                    changed.extend((waited + more, result) for more, result in rule.change(passing))
                else:
                    changed.append((waited, passing))
            outcomes = changed
        return outcomes

    def _add(self, rule: Fault) -> Fault:
        self._rules = [other for other in self._rules if other.remaining != 0]
        self._rules.append(rule)
        return rule
