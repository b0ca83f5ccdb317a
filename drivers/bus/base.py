"""The `Bus` protocol: all that the master and the simulator may know of a wire."""

from __future__ import annotations

import enum
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Protocol

from drivers.bus.frame import Frame


class BusState(enum.StrEnum):
    """How well the wire serves us (the controller's error states of ISO 11898-1, and the link's own)."""

    CLOSED = "closed"
    """Not opened yet, or closed on purpose."""
    ACTIVE = "active"
    """Error active: frames flow."""
    WARNING = "warning"
    """An error counter passed 96."""
    PASSIVE = "passive"
    """Error passive: an error counter passed 127."""
    BUS_OFF = "bus_off"
    """The controller took itself off the bus. Nothing we send arrives, whatever `send` said."""
    DOWN = "down"
    """The interface or its server is gone; the bus tries to open it again."""

    @property
    def can_send(self) -> bool:
        """Whether a frame handed to `Bus.send` has a chance to reach the wire."""
        return self in (BusState.ACTIVE, BusState.WARNING, BusState.PASSIVE)


FrameHandler = Callable[[Sequence[Frame]], None]
"""Called in the event loop with the batch of frames that one wake-up found, oldest first. Must not block."""

StateHandler = Callable[[BusState, str], None]
"""Called in the event loop when the state changed, with a sentence that says why."""


@dataclass(frozen=True, slots=True)
class BusCounters:
    """What a bus carried since it was made; a snapshot. None of them ever decreases."""

    received: int = 0
    """Frames handed to the subscribers, error frames included."""
    sent: int = 0
    """Frames handed to the wire. Whether a node acknowledged them is not known."""
    dropped: int = 0
    """Frames lost on our side: refused by a full queue, stale in it, or received faster than handled."""
    reopened: int = 0
    """How often a lost wire was opened again."""


@dataclass(frozen=True, slots=True)
class Beside:
    """How another process opens the same wire while this one has it open: see `drivers.bus.beside`."""

    interface: str
    """``socketcan`` or ``socketcand``."""
    channel: str
    host: str = ""
    """Of the socketcand server."""
    port: int = 0


class Bus(Protocol):
    """A CAN bus that an event loop owns.

    All methods are called from that loop's thread. A bus reopens what fails under it by itself, with a
    bounded back-off, and says so through the state handlers; it raises only for what the caller did.
    """

    @property
    def name(self) -> str:
        """What a person calls this bus, e.g. ``socketcan:can0``."""
        ...

    @property
    def state(self) -> BusState:
        """The state now."""
        ...

    @property
    def counters(self) -> BusCounters:
        """What this bus carried so far."""
        ...

    @property
    def beside(self) -> Beside | None:
        """How another process opens this wire too; None if it is this process's alone."""
        ...

    async def open(self) -> None:
        """Open the wire and start reading.

        Raises `drivers.errors.BusDown` if that fails; the bus is then closed, tries nothing by itself, and
        may be opened again.
        """
        ...

    async def close(self) -> None:
        """Stop reading, flush what can be flushed within 100 ms, close. Idempotent."""
        ...

    def send(self, frame: Frame, *, urgent: bool = False, answered: bool = True) -> None:
        """Hand a frame to the wire without blocking.

        `urgent` frames (stop, quick stop, heartbeat, NMT) overtake whatever waits in the transmit queue and
        have a reserve of their own in it. After one that is `answered`, what arrives is handed over at once;
        a heartbeat is not, so that a stream goes on being read in batches. A frame that can't leave within a
        quarter of a second is dropped and counted: an old set point must not move a motor when the wire comes
        back. Raises `drivers.errors.BusDown` if the state can't send, `drivers.errors.BusOverflow` if the
        queue is full, and `drivers.errors.BadValue` for what no controller can send.
        """
        ...

    def withdraw(self, cob_ids: Collection[int]) -> int:
        """Take back what waits in the transmit queue with one of these identifiers; how many frames.

        For what is superseded: the last set point is the one that counts, and after a stop none does.
        """
        ...

    def subscribe(self, on_frames: FrameHandler, on_state: StateHandler | None = None) -> Callable[[], None]:
        """Have handlers called from now on; returns the function that ends it."""
        ...
