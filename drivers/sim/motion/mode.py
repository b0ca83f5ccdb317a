"""What every mode of operation answers to, and the mode in which nothing runs."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.cia402 import objects
from drivers.sim.motion.context import Context
from drivers.sim.motion.goals import Stop


class ModeControl:
    """A mode of operation. This base is mode 0: the motor doesn't run (manual §5.1.6)."""

    def __init__(self, context: Context) -> None:
        self.context = context

    def slow_down(self) -> Stop:
        """The stop with the mode's own deceleration (605Ah 1 and 5, 605Ch, 605Dh).

        Modes without a ramp of their own take 6085h: unverified on hardware.
        """
        return self.quick_stop()

    def quick_stop(self) -> Stop:
        """The stop with 6085h."""
        return Stop(self.context.acceleration(objects.QUICK_STOP_DECELERATION))

    def begin(self, now: float) -> None:
        """The mode is displayed and OPERATION_ENABLED: set points count from now on."""

    def end(self, now: float) -> None:
        """Set points count no more; the axis itself stops the motor."""

    def control(self, previous: int, word: int, now: float) -> None:
        """A controlword was written while the mode is displayed."""

    def written(self, index: int, now: float) -> None:
        """One of the axis's objects was written while the mode is displayed."""

    def sync(self, now: float) -> None:
        """A SYNC came."""

    def observe(self, now: float) -> None:
        """Something happened: a leg ended, a mark was passed, a deadline came."""

    def deadline(self) -> float | None:
        """When `observe` must be called at the latest."""
        return None

    def marks(self) -> Iterable[float]:
        """Counter values at which `observe` must be called."""
        return ()

    def bits(self, now: float) -> int:
        """Bits 10 to 13 of the statusword."""
        del now
        return 0

    def expects_limit(self, direction: int) -> bool:
        """Whether the mode itself deals with the limit switch in a direction."""
        del direction
        return False

    @property
    def ignores_software_limits(self) -> bool:
        """Whether positions mean nothing yet."""
        return False
