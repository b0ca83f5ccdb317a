"""The rules that one fault panel has on the wire: what becomes of frames with a COB-ID."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from drivers.bus.faults import Fault, Faults, cob_id
from drivers.bus.frame import Frame
from drivers.errors import BadValue
from drivers.sim.snapshot import WireFaultSnapshot

MOST: Final = 64
"""Rules that one panel keeps, those that have struck their last frame included."""


@dataclass(frozen=True, slots=True)
class _Rule:
    kind: str
    cob_id: int
    fault: Fault


class WireFaults:
    """Adds rules to a wire's `Faults` and remembers them, to show and to end just these.

    In each method `count` is how many frames are struck; None = all from now on.
    """

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._rules: list[_Rule] = []

    def drop(self, identifier: int, count: int | None) -> None:
        """Lose frames."""
        self._add("drop", identifier, self._faults.drop(cob_id(identifier), count))

    def delay(self, identifier: int, seconds: float, count: int | None) -> None:
        """Let frames arrive later."""
        self._add("delay", identifier, self._faults.delay(cob_id(identifier), seconds, count))

    def duplicate(self, identifier: int, count: int | None) -> None:
        """Let frames arrive twice."""
        self._add("duplicate", identifier, self._faults.duplicate(cob_id(identifier), count))

    def corrupt(self, identifier: int, byte: int, bits: int, count: int | None) -> None:
        """Flip `bits` of a byte in frames that have it."""

        def flip(frame: Frame) -> Frame:
            data = bytearray(frame.data)
            data[byte] ^= bits
            return frame._replace(data=bytes(data))

        self._change("corrupt", identifier, flip, lambda frame: len(frame.data) > byte, count)

    def truncate(self, identifier: int, length: int, count: int | None) -> None:
        """Cut longer frames to `length` bytes."""

        def cut(frame: Frame) -> Frame:
            return frame._replace(data=frame.data[:length])

        self._change("truncate", identifier, cut, lambda frame: len(frame.data) > length, count)

    def clear(self) -> None:
        """End these rules; those of others on the same wire stay."""
        for rule in self._rules:
            rule.fault.end()
        self._rules.clear()

    def snapshot(self) -> tuple[WireFaultSnapshot, ...]:
        """All rules, the latest last."""
        return tuple(
            WireFaultSnapshot(rule.kind, rule.cob_id, rule.fault.hits, rule.fault.remaining)
            for rule in self._rules
        )

    def _change(
        self,
        kind: str,
        identifier: int,
        change: Callable[[Frame], Frame],
        fits: Callable[[Frame], bool],
        count: int | None,
    ) -> None:
        def strikes(frame: Frame) -> bool:
            return frame.cob_id == identifier and fits(frame)

        self._add(kind, identifier, self._faults.corrupt(change, strikes, count))

    def _add(self, kind: str, identifier: int, fault: Fault) -> None:
        if len(self._rules) == MOST:
            self._rules = [rule for rule in self._rules if rule.fault.remaining != 0]
        if len(self._rules) == MOST:
            fault.end()
            raise BadValue(f"{MOST} wire faults are on already", hint="End them with end_wire_faults.")
        self._rules.append(_Rule(kind, identifier, fault))
