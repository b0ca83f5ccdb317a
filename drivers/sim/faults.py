"""What can be wrong with a module's communication: switches that the runner looks at for each frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.nmt import NmtState


@dataclass(slots=True)
class NodeFaults:
    """All off by default. May be changed at any time; what is on its way already stays on it."""

    silent: bool = False
    """Sends nothing, as with a broken transmitter; it still hears and obeys."""
    deaf: bool = False
    """Hears nothing, as with a broken receiver; it still sends what is due by itself."""
    sdo_delay: float = 0.0
    """Seconds (>= 0) by which each SDO response comes late."""
    sdo_mute: bool = False
    """Never answers an SDO, though it carries it out."""
    no_boot_up: bool = False
    """Does not send its boot-up message."""
    corrupt: Callable[[Frame], Frame | None] | None = None
    """Changes each frame that the module sends; None from it drops the frame."""

    def clear(self) -> None:
        """Switch everything off."""
        self.silent = self.deaf = self.sdo_mute = self.no_boot_up = False
        self.sdo_delay = 0.0
        self.corrupt = None

    def outgoing(self, frame: Frame) -> tuple[float, Frame] | None:
        """What becomes of a frame that the module sends: its delay in seconds and itself, or None if lost."""
        service, _node = cob.classify(frame.cob_id)
        if self.silent:
            return None
        if service is cob.Service.HEARTBEAT and self.no_boot_up and frame.data == bytes((NmtState.BOOT_UP,)):
            return None
        answers = service is cob.Service.SDO_RESPONSE
        if answers and self.sdo_mute:
            return None
        changed = frame if self.corrupt is None else self.corrupt(frame)
        return None if changed is None else (self.sdo_delay if answers else 0.0, changed)
