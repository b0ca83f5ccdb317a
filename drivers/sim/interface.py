"""What the two halves of the simulated module know of each other: communication, and the drive of one axis.

The communication half owns the object dictionary and has checked access, length, range and allowed values
before an axis hears of a write. The axis owns the drive: it lives on `now` (seconds on a monotonic clock),
has no ticker, and says when it next wants to be woken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from drivers.cia301.emcy import Emergency
from drivers.cia301.sdo import AbortCode
from drivers.cia402.power import PowerState

RaiseEmergency = Callable[[Emergency], None]
"""Called by an axis from within any call that gives it `now`.

`Emergency.register` holds the bits of 1001h that this axis keeps set from now on: 0 in a fault reset. The
module sends the union of its own bits and of all axes' ones.
"""


class AxisParameters(Protocol):
    """The stored objects of one axis (and of the module), by the index that the manual prints for motor 0."""

    def get(self, base_index: int, sub: int = 0) -> int:
        """The value now. Raises KeyError if there is no such object."""
        ...

    def set(self, base_index: int, sub: int, value: int) -> None:
        """Store what the drive itself changes; no check, and `AxisUnit.written` is not called."""
        ...


class AxisUnit(Protocol):
    """One axis, as the communication half drives it."""

    @property
    def state(self) -> PowerState:
        """State of the power state machine at the last `now` that the axis was given."""
        ...

    @property
    def moving(self) -> bool:
        """Whether position, velocity or another continuous value changes by itself now."""
        ...

    def may_write(self, base_index: int, sub: int, value: int, now: float) -> AbortCode | None:
        """The drive's own veto against a write that passed all checks of the dictionary; None = none.

        It changes nothing but what `advance` does: all entries of a PDO are asked about before one is
        written.
        """
        ...

    def written(self, base_index: int, sub: int, value: int, now: float) -> None:
        """The object holds `value` now: act on it. May raise `SdoAbort`; the old value is then put back."""
        ...

    def read(self, base_index: int, sub: int, now: float) -> int | None:
        """The live value of an object (6041h, 6064h, ...); None = not live, the stored value holds."""
        ...

    def advance(self, now: float) -> None:
        """Bring the drive up to `now`. Idempotent; `now` never goes back."""
        ...

    def next_event(self, now: float) -> float | None:
        """When something discrete happens next (end of a ramp, a switch); None = nothing will by itself."""
        ...

    def sync(self, now: float) -> None:
        """A SYNC came, and synchronous PDOs were applied: csp and csv take their set points now."""
        ...

    def nmt_stopped(self, now: float) -> None:
        """The module entered NMT Stopped: OPERATION_ENABLED becomes FAULT (manual §2.2)."""
        ...

    def reset(self, now: float) -> None:
        """The node was reset or powered on: initial state, position 0; parameters hold their reset values."""
        ...

    def power_off(self, now: float) -> None:
        """The supply is gone: no current, no torque, nothing remembered."""
        ...
