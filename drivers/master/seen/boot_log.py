"""What became of each step of a node's boot-up: what was compared, what was written, and why it failed."""

from __future__ import annotations

import asyncio
import enum
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from drivers.cia301.objects import Address
from drivers.errors import CanaxisError

KEPT_CHANGES = 64
"""How many written objects one step names; `BootStep.written` counts them all."""


class BootStepName(enum.StrEnum):
    """The steps, in their order."""

    IDENTITY = "identity"
    """1000h and 1018h against the configured model; reads only."""
    AXES = "axes"
    """6041h, 6061h, 6064h and 606Ch of every axis, before anything is written: who is running already?"""
    HEARTBEATS = "heartbeats"
    """1016h, 1017h and 1029h: the watch over the node, and the node's watch over us."""
    PARAMETERS = "parameters"
    """What the user's settings want of every axis: ramps, limits, options."""
    PDOS = "pdos"
    """The PDO plan: identifiers, mappings, timers."""
    START = "start"
    """NMT Operational, as its status PDOs or its heartbeat show it."""
    STATUS = "status"
    """Both status PDOs of every axis."""


class StepState(enum.StrEnum):
    """How far a step is."""

    PENDING = "pending"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    SKIPPED = "skipped"
    """Nothing was to be done; `BootStep.note` says why."""


@dataclass(frozen=True, slots=True)
class Change:
    """One object that held something else than it should, and was written."""

    address: Address
    name: str
    axis: int | None
    """None: the object is the node's."""
    old: int | None
    """None: it could not be read before."""
    new: int
    unit: str
    """Of both values; "" for a plain number."""


@dataclass(frozen=True, slots=True)
class BootStep:
    """One step of one boot-up."""

    name: BootStepName
    state: StepState = StepState.PENDING
    compared: int = 0
    """Objects that were read and held against what they should be."""
    written: int = 0
    """Objects that differed and were written, then read back."""
    changes: tuple[Change, ...] = ()
    """The first `KEPT_CHANGES` of them."""
    note: str = ""
    """What was found, as sentences."""
    reason: str = ""
    """Why it failed, as a sentence."""
    remedy: str = ""
    """What to do about that."""
    took_s: float | None = None
    """Seconds; None until it has ended."""


class BootLog:
    """One node's last boot-up. `on_change` is told when a step begins or ends."""

    def __init__(self, on_change: Callable[[], None]) -> None:
        self._on_change = on_change
        self._running: BootStepName | None = None
        self._steps: dict[BootStepName, BootStep] = {}
        self.clear()

    @property
    def steps(self) -> tuple[BootStep, ...]:
        """All steps, in their order."""
        return tuple(self._steps.values())

    def clear(self) -> None:
        """Another boot-up begins."""
        self._running = None
        self._steps = {name: BootStep(name) for name in BootStepName}

    @contextmanager
    def step(self, name: BootStepName) -> Generator[None]:
        """Run a step; what it raises goes through, and into its reason and remedy."""
        loop = asyncio.get_running_loop()
        begun = loop.time()
        self._running = name
        self._replace(BootStep(name, StepState.RUNNING))
        self._on_change()
        state, reason, remedy = StepState.FAILED, "Something else happened to the node.", "It starts anew."
        try:
            yield
            state = self._steps[name].state
            state, reason, remedy = StepState.DONE if state is StepState.RUNNING else state, "", ""
        except CanaxisError as error:
            reason, remedy = error.message, error.hint
            raise
        finally:
            took = loop.time() - begun
            if self._running is name:  # else another boot-up has begun meanwhile
                self._replace(
                    replace(self._steps[name], state=state, reason=reason, remedy=remedy, took_s=took)
                )
                self._running = None
                self._on_change()

    # What follows belongs to the step that runs; between steps nobody keeps it.

    def compared(self) -> None:
        """An object was held against what it should be."""
        if self._running is not None:
            step = self._steps[self._running]
            self._replace(replace(step, compared=step.compared + 1))

    def wrote(self, change: Change) -> None:
        """An object differed and was written."""
        if self._running is not None:
            step = self._steps[self._running]
            kept = (*step.changes, change)[:KEPT_CHANGES]
            self._replace(replace(step, written=step.written + 1, changes=kept))

    def note(self, sentence: str) -> None:
        """Add to what was found."""
        if self._running is not None:
            step = self._steps[self._running]
            self._replace(replace(step, note=f"{step.note} {sentence}".strip()))

    def skip(self, sentence: str) -> None:
        """The running step has nothing to do."""
        self.note(sentence)
        if self._running is not None:
            self._replace(replace(self._steps[self._running], state=StepState.SKIPPED))

    def _replace(self, step: BootStep) -> None:
        self._steps[step.name] = step
