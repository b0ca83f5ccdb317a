"""The EMCY producer: 1001h, 1014h, 1015h (manual §3.1.2, §3.1.9, §3.1.10, §11)."""

from __future__ import annotations

from collections import deque
from typing import Final

from drivers.bus.frame import Frame
from drivers.cia301.cob import MAX_COB_ID, is_restricted
from drivers.cia301.emcy import Emergency
from drivers.cia301.sdo import AbortCode

MODULE: Final = 255
"""Byte #2 of an emergency that concerns no single axis."""
WAITING: Final = 32
"""Emergencies that may wait for the inhibit time; a newer one then pushes the oldest out."""

_DISABLED: Final = 1 << 31

_GENERIC, _COMMUNICATION = 0x01, 0x10


def register_of(code: int) -> int:
    """The bits of 1001h of a module-wide code, by its class (CiA 301 §7.5.2.2). Unverified on hardware."""
    return _GENERIC | _COMMUNICATION if code >> 8 in (0x81, 0x82) else _GENERIC


def veto_cob_id(value: int) -> AbortCode | None:
    """Why 1014h does not take a value: 11-bit identifiers only, and none that CiA 301 restricts."""
    if value & ~(_DISABLED | MAX_COB_ID) or (not value & _DISABLED and is_restricted(value)):
        return AbortCode.INVALID_VALUE
    return None


class EmergencyProducer:
    """Sends emergencies one inhibit time apart, and keeps the error register."""

    def __init__(self, axes: int) -> None:
        self._axes = [0] * axes
        self._lasting = 0
        self._cob_id = _DISABLED
        self._inhibit = 0.0
        self._waiting: deque[Emergency] = deque(maxlen=WAITING)
        self._sent_at = float("-inf")

    @property
    def register(self) -> int:
        """1001h: what lasts of all errors of the module and of its axes."""
        register = self._lasting
        for bits in self._axes:
            register |= bits
        return register

    def configure(self, cob_id: int, inhibit_100us: int) -> None:
        """1014h and 1015h, as they are now."""
        self._cob_id = cob_id
        self._inhibit = inhibit_100us / 10_000

    def reset(self) -> None:
        """Forget everything, as a reset of the node does."""
        self._axes = [0] * len(self._axes)
        self._lasting = 0
        self.silence()

    def silence(self) -> None:
        """Drop what waits: NMT Stopped sends no emergencies."""
        self._waiting.clear()

    def from_axis(self, axis: int, emergency: Emergency) -> None:
        """Queue what an axis raised; see `RaiseEmergency` for its register.

        What concerns the module (5441h) is raised by each axis, but sent once.
        """
        self._axes[axis] = emergency.register
        waits = any((other.code, other.data) == (emergency.code, emergency.data) for other in self._waiting)
        if not (waits and emergency.data[1] == MODULE):
            self._queue(emergency.code, emergency.data, 0)

    def passing(self, code: int, detail: int = 0) -> None:
        """Queue a module-wide error that is over at once: its bits are in the message, not in 1001h."""
        self._queue(code, bytes((detail, MODULE, 0, 0, 0)), register_of(code))

    def lasting(self, code: int, detail: int = 0) -> None:
        """Queue a module-wide error that stays in 1001h until `recovered`."""
        self._lasting |= register_of(code)
        self.passing(code, detail)

    def recovered(self) -> None:
        """All module-wide errors are over: 0000h (CiA 301 §7.2.7.1). Unverified on hardware."""
        if self._lasting:
            self._lasting = 0
            self._queue(0, bytes((0, MODULE, 0, 0, 0)), 0)

    def forget(self) -> None:
        """All module-wide errors are over, and nobody is told: the communication was reset."""
        self._lasting = 0
        self.silence()

    def next_wakeup(self) -> float | None:
        """When the next one that waits may be sent."""
        return self._sent_at + self._inhibit if self._waiting else None

    def poll(self, now: float) -> list[Frame]:
        """What may be sent now."""
        frames: list[Frame] = []
        while self._waiting and now >= self._sent_at + self._inhibit:
            emergency = self._waiting.popleft()
            if not self._cob_id & _DISABLED:
                frames.append(Frame(self._cob_id, emergency.encode()))
                self._sent_at = now
        return frames

    def _queue(self, code: int, data: bytes, register: int) -> None:
        self._waiting.append(Emergency(code, self.register | register, data))
